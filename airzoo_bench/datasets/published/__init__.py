"""Published benchmarks as they are downloaded, a module each."""
