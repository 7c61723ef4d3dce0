"""The interactive viewer and the video overlay."""
