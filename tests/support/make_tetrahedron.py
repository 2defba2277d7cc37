"""Writes a tetrahedron as GLB. usage: make_tetrahedron.py OUT.glb"""

import sys

import glb

CORNERS = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
FACES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]

if __name__ == "__main__":
    glb.write_glb(sys.argv[1], CORNERS, FACES)
