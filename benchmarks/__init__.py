"""Benchmarks: problems and schemes as data, one runner each, results as JSON, tables and plots."""
