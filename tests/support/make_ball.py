"""Writes a closed, bumpy ball of 500 triangles as GLB: the small mesh of the load tests. usage: make_ball.py OUT.glb"""

import math
import sys

import glb

SEGMENTS, RINGS = 25, 11  # 2 * 25 * (11 - 1) triangles


def ball():
    corners = [[0.0, 1.0, 0.0]]
    for ring in range(1, RINGS):
        for segment in range(SEGMENTS):
            polar, round_about = math.pi * ring / RINGS, 2 * math.pi * segment / SEGMENTS
            radius = 1 + 0.1 * math.sin(5 * polar) * math.cos(4 * round_about)
            corners.append([radius * math.sin(polar) * math.cos(round_about), radius * math.cos(polar),
                            radius * math.sin(polar) * math.sin(round_about)])
    corners.append([0.0, -1.0, 0.0])
    at = lambda ring, segment: 1 + (ring - 1) * SEGMENTS + segment % SEGMENTS
    faces = []
    for segment in range(SEGMENTS):
        faces.append([0, at(1, segment + 1), at(1, segment)])
        faces.append([len(corners) - 1, at(RINGS - 1, segment), at(RINGS - 1, segment + 1)])
        for ring in range(1, RINGS - 1):
            a, b, c, d = at(ring, segment), at(ring, segment + 1), at(ring + 1, segment), at(ring + 1, segment + 1)
            faces += [[a, b, c], [b, d, c]]
    return corners, faces


if __name__ == "__main__":
    glb.write_glb(sys.argv[1], *ball())
