#!/usr/bin/env bash
# Installs Debian packages that are missing; does nothing, fast, when all are there.
#
# usage: apt_install.sh LIST_FILE_OR_PACKAGE...
#   An argument that names a file is read as a list: one package a line, '#' starts a comment.
#   Anything else is a package.
#
# Exit: 0 when everything is installed, or when this is no Debian-like system or the user may not install (then it
# says what to install by hand, and the build goes on: the tools may have come another way); 1 when apt failed.
set -euo pipefail

wanted=()
for argument in "$@"; do
  if [[ -f "$argument" ]]; then
    mapfile -t lines < <(sed -e 's/#.*//' -e 's/[[:space:]]//g' -e '/^$/d' "$argument")
    wanted+=("${lines[@]}")
  else
    wanted+=("$argument")
  fi
done
[[ ${#wanted[@]} -gt 0 ]] || { echo "usage: $0 LIST_FILE_OR_PACKAGE..." >&2; exit 2; }

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "setup: no apt on this system; install the equivalents of: ${wanted[*]}" >&2
  exit 0
fi

installed="$(dpkg-query -W -f '${db:Status-Status} ${Package}\n' 2>/dev/null | sed -n 's/^installed //p' | sort -u)"
missing=()
for package in "${wanted[@]}"; do
  grep -qxF -- "$package" <<<"$installed" || missing+=("$package")
done
if [[ ${#missing[@]} -eq 0 ]]; then
  exit 0
fi

as_root=()
if [[ "$(id -u)" -ne 0 ]]; then
  if command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [[ -t 0 ]]; }; then
    as_root=(sudo)
  else
    echo "setup: not root and no sudo, so these are not installed: ${missing[*]}" >&2
    echo "setup: as root: apt-get install ${missing[*]}" >&2
    exit 0
  fi
fi

echo "setup: installing ${#missing[@]} packages: ${missing[*]}"
apt() {
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300 \
    -o Dpkg::Use-Pty=0 "$@" </dev/null
}
# A fresh machine has no package lists. A source that cannot be reached is not fatal here: what matters is the install.
apt update >/dev/null || echo "setup: apt-get update reported errors; trying to install all the same" >&2
log="$(mktemp)"
trap 'rm -f "$log"' EXIT
if ! apt install -y --no-install-recommends "${missing[@]}" >"$log" 2>&1; then
  tail -n 30 "$log" >&2
  echo "setup: apt-get install failed" >&2
  exit 1
fi
