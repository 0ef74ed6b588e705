"""Formats of robots and of logs beyond the core, one a file, found through registries."""
