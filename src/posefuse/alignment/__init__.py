"""Where the floor is, which way is up and forward, and how large the world is: from people and from what is told."""
