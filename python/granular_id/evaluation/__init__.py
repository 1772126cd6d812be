"""Evaluation that can be believed."""
