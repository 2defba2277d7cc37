#!/usr/bin/env bash
# Makes the pictures of README.md and client/README.md: gallery.sh VOXELPIPE OUT_DIR. Needs Debian's assimp-testmodels,
# and python3-pil, which makes the files small; for that of the viewer docker/packages-browser.txt and npm.
# Those of other programs: tests/formats/reader_pictures.py.
set -euo pipefail
voxelpipe="$(realpath "${1:?usage: gallery.sh VOXELPIPE OUT_DIR}")"
out="$(realpath -m "${2:?usage: gallery.sh VOXELPIPE OUT_DIR}")"
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
bash tests/support/apt_install.sh assimp-testmodels python3-pil
models=/usr/share/assimp/models
engine="$models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb"
mkdir -p "$out"

shrink() { # NAME: NAME.full.png becomes NAME.png
  local name="$1"
  bash tests/support/python.sh - "$out/$name.full.png" "$out/$name.png" <<'PYTHON'
import sys
from PIL import Image
picture = Image.open(sys.argv[1]).convert("RGB")
if picture.width > 1000:
    picture = picture.resize((640, 480), Image.LANCZOS)
picture.quantize(192, dither=Image.Dither.NONE).save(sys.argv[2], optimize=True)
PYTHON
  rm "$out/$name.full.png"
  ls -l "$out/$name.png" | awk '{print $5, $9}'
}

draw() { # NAME MESH OPTION...
  local name="$1"
  shift
  "$voxelpipe" voxelize "$@" --preview "$out/$name.full.png" >/dev/null
  shrink "$name"
}

draw textures "$models/OBJ/spider.obj" --resolution 384 --target bit:or \
  --target u8x4:average:shader=base_color,encoding=srgb
draw cut "$engine" --resolution 320 --clip=-340,-140,-140,340,140,5 --fill nonzero --target bit:or \
  --target u8x4:average:shader=base_color,encoding=srgb --view 20,25
draw depth "$engine" --resolution 192 --coverage thin --result buckets
draw velocity "$engine" --resolution 256 --fill nonzero \
  --vertex-shader identity:linear_velocity=1/0/0,angular_velocity=0/0/3 --target bit:or --target f32x3:average:shader=velocity

"$voxelpipe" voxelize "$engine" --resolution 256 --fill nonzero --target bit:or \
  --target u8x4:average:shader=base_color,encoding=srgb -o "$out/viewer.html" >/dev/null
modules="$out/node_modules"
if [[ ! -d "$modules" ]]; then
  cp tests/formats/package.json tests/formats/package-lock.json "$out"
  npm ci --prefix "$out" --no-audit --no-fund --silent
fi
node tests/formats/viewer_picture.mjs "$modules" "$(command -v chromium-headless-shell)" "$out/viewer.html" \
  "$out/viewer.full.png" 20,25 "z shown up to=0.52"
shrink viewer
