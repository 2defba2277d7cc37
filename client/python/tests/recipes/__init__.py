"""The recipes for parts in README.md, and scenes of several solids made by code."""
