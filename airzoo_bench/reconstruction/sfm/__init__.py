"""Structure from motion, for the baseline."""
