"""Multi-view reconstruction: clouds against the ground truth."""
