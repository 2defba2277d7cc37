"""Tests of meshes of several parts."""
