"""Tests of the package voxelpipe. Those with a server start voxelpiped: see conftest.py."""
