"""Benchmarks and results for other platforms: Codabench, EvalAI, Hugging Face."""
