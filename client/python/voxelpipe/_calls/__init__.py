"""Calls on a server: bytes, messages, retries, results."""
