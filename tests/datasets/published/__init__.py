"""Tests of published benchmarks, each with a tree as it is downloaded."""
