"""Options that a request does not have as they are given: turned axes, a box in place of a grid, names of targets."""
