#!/usr/bin/env python3
"""A torch DataLoader whose workers, forked processes, voxelize meshes while the model trains.

usage: torch_loader.py MESH... [--resolution N] [--batch N] [--workers N]

A client opens its connection in the process that uses it, so one made before the fork works in every worker.
"""
import argparse
import pathlib
from typing import Any

import torch
import torch.utils.data

import voxelpipe


class Voxels:
    """A map-style dataset: item i is the occupancy of mesh i, float32 (1, N, N, N), and its number.

    Of a mesh that cannot be read, or is empty, all zeros and -1: a batch keeps its shape, and training leaves it out.
    """

    def __init__(self, meshes: list[pathlib.Path], resolution: int, client: voxelpipe.Client) -> None:
        self.meshes = meshes
        self.resolution = resolution
        self.client = client

    def __len__(self) -> int:
        return len(self.meshes)

    def __getitem__(self, i: int) -> tuple[Any, int]:
        if i >= len(self.meshes):
            raise IndexError(i)
        try:
            grid = self.client.voxelize(self.meshes[i], resolution=self.resolution, fit="cube")
        except (voxelpipe.InvalidMesh, voxelpipe.TooLarge):
            return torch.zeros((1,) + (self.resolution,) * 3), -1
        return grid.to_torch().float()[None], i if grid.summary.occupied > 0 else -1


def main() -> None:
    """Parses the command line; where the model would train, it prints the batches."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=pathlib.Path, nargs="+")
    parser.add_argument("--resolution", type=int, default=32)
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    dataset: Any = Voxels(given.meshes, given.resolution, voxelpipe.default_client())
    loader = torch.utils.data.DataLoader(
        dataset, batch_size=given.batch, num_workers=given.workers, multiprocessing_context="fork"
    )
    for epoch in range(2):
        for voxels, numbers in loader:
            print(f"epoch {epoch}: meshes {numbers.tolist()}, {tuple(voxels.shape)}, {int(voxels.sum())} occupied")


if __name__ == "__main__":
    main()
