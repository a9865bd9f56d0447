"""Export: folders of frames, the photos and truth of the benchmark, pictures for people."""
