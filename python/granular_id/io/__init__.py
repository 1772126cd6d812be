"""Readers of recordings: one file per format; `load` picks it."""
