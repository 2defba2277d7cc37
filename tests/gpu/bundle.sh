#!/usr/bin/env bash
# usage: bundle.sh BUILD_DIR OUT_DIR [MODEL...]     (make gpu-bundle GPU_MODELS="...")
# Puts all that tests/gpu/run.sh needs on a machine with a driver and the CUDA toolkit alone into OUT_DIR: bin/
# (stripped, as lib/ packed), lib/ (what the binaries link, but for the C and C++ runtimes), models/, run.sh. A .gltf brings its whole
# directory. Prints the size; fails above 60 MiB.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
build_dir="$1"
out="$2"
shift 2

rm -rf "$out"
mkdir -p "$out/bin" "$out/lib" "$out/models"
binaries=()
for name in cuda_parity cuda_bench cuda_devices device_parity plan_bounds voxelpipe voxelpiped mesh_fuzz parser_fuzz \
  whole_calls whole_calls_bench; do
  if [[ -x "$build_dir/bin/$name" ]]; then binaries+=("$build_dir/bin/$name"); fi
done
cp "${binaries[@]}" "$out/bin/"
strip "$out"/bin/*

# The other machine's toolkit has CUDA's libraries, and its C and C++ runtimes are at least as new as these.
theirs='libc|libm|libdl|librt|libpthread|libresolv|libstdc\+\+|libgcc_s|libnvrtc|libcuda|libcudart|ld-linux.*'
ldd "${binaries[@]}" | awk '$2 == "=>" && $3 ~ /^\// {print $3}' | sort -u | grep -Ev "/($theirs)\.so" |
  while read -r library; do cp -L "$library" "$out/lib/"; done
find "$out/lib" -type f -exec strip --strip-unneeded {} + 2>/dev/null || true
gzip "$out"/bin/* "$out"/lib/*  # run.sh unpacks them

/usr/bin/python3 tests/support/make_tetrahedron.py "$out/models/tetrahedron.glb"
/usr/bin/python3 tests/support/make_ball.py "$out/models/ball.glb"
for model in "$@"; do
  case "$model" in
    *.gltf)
      directory="$(dirname "$model")"
      target="$out/models/$(basename "$model" .gltf)"
      mkdir -p "$target"
      find "$directory" -maxdepth 1 -type f -exec cp {} "$target/" \;
      ;;
    *) cp "$model" "$out/models/" ;;
  esac
done
chmod -R u+w "$out"
cp tests/gpu/run.sh tests/gpu/profile_table.py tests/gpu/service_row.py \
  tests/bench/bench_file.py tests/bench/import_results.py "$out/"
git describe --always --dirty 2>/dev/null >"$out/COMMIT" || echo unknown >"$out/COMMIT"

bytes="$(du -sb "$out" | cut -f1)"
count() { find "$out/$1" -type f | wc -l; }
echo "$out: $((bytes / 1024 / 1024)) MiB, $(count bin) binaries, $(count lib) libraries, $(count models) model files," \
  "commit $(cat "$out/COMMIT")"
((bytes < 60 * 1024 * 1024)) || { echo "bundle.sh: larger than 60 MiB" >&2; exit 1; }
