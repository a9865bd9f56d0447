"""Intervals, paired tests, resampling: numbers in, numbers out."""
