"""Meshes in every form that callers have, as files."""
