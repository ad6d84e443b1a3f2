"""Loggers that people already have: recorders, a file and an extra each."""
