"""Two points from left and right rays whose labels are not believed."""
