"""Inspecting many recordings: engines, restart, and what is made of the results."""
