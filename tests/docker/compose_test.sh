#!/usr/bin/env bash
# Checks that compose accepts docker/compose.yaml: every file that it names exists, and both targets are in the
# Dockerfile.
# Skips (exit 77, reason printed) where no compose is installed; nothing is built or started.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
fail() { echo "FAILED: $*" >&2; exit 1; }

if docker compose version >/dev/null 2>&1; then
  compose=(docker compose)
elif command -v docker-compose >/dev/null; then
  compose=(docker-compose)
else
  echo "SKIPPED: neither 'docker compose' nor docker-compose is installed"
  exit 77
fi

for target in cpu cuda; do
  text="$(VOXELPIPE_TARGET="$target" "${compose[@]}" -f docker/compose.yaml -f docker/compose.gpu.yaml --profile load config)" ||
    fail "compose does not take the files (target $target)"
  for service in voxelpiped prometheus load; do
    grep -q "^  $service:" <<<"$text" || fail "service $service is missing"
  done
  grep -q "target: $target" <<<"$text" || fail "target $target is not built"
  grep -q "^FROM .* AS $target$" docker/Dockerfile || fail "docker/Dockerfile has no target $target"
  while read -r file; do
    [[ -f "$file" ]] || fail "$file is mounted and not there"
  done < <(sed -n 's/^ *source: \(.*\)$/\1/p' <<<"$text")
done
echo "PASSED with ${compose[*]}"
