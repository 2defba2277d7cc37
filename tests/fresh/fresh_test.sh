#!/usr/bin/env bash
# Proves that README's two commands need nothing but a bare Debian 12 with git and make: each of them runs alone in a
# copy of a tree that debootstrap made, in a clone of the commit that is checked out, without this machine's packages,
# environment, programs and compiler cache. What is not committed is not part of it.
#
# usage: fresh_test.sh [--only demo|test] [--keep]     (make fresh-test)
#   --only  one of the two commands
#   --keep  leave the trees, and say where
# environment:
#   VOXELPIPE_FRESH_DIR  where the trees are made, a folder on a disk with some 10 GiB free; default: TMPDIR
# Logs: build-fresh/. Needs root, the network and about as long as both commands take.
# Exit: 0 passed; 77 skipped with a printed reason; anything else failed.
#
# The addresses of the mirror, of proxies and of npm's registry are those that this machine is set up with.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

usage() { sed -n 's/^# usage: /usage: /p' "${BASH_SOURCE[0]}" >&2; exit 2; }
commands=(demo test)
keep=0
while [[ $# -gt 0 ]]; do
  case "$1" in
    --only) [[ "${2:-}" == demo || "${2:-}" == test ]] || usage; commands=("$2"); shift 2 ;;
    --keep) keep=1; shift ;;
    *) usage ;;
  esac
done

work=
running=
cleanup() {
  if [[ -n "$running" ]]; then
    kill -KILL "$running" 2>/dev/null || true
    wait "$running" 2>/dev/null || true
  fi
  [[ -n "$work" ]] || return 0
  if [[ "$keep" -eq 1 ]]; then
    echo "fresh-test: the trees are in $work"
    return 0
  fi
  # The mounts were never in this namespace. The last processes of the other one may take a moment to end.
  local _
  for _ in $(seq 50); do
    rm -rf --one-file-system "$work" 2>/dev/null && return 0
    sleep 0.2
  done
  echo "fresh-test: $work could not be removed" >&2
}
trap cleanup EXIT
trap 'exit 129' HUP
trap 'exit 130' INT
trap 'exit 143' TERM

say() { echo "fresh-test: $*"; }
fail() { say "$*: failed" >&2; exit 1; }
skip() { echo "skipped: $*"; exit 77; }

# Runs a command in mount and process namespaces of its own, which end with it, with this script, and with whatever
# kills this script.
contained() {
  local status=0
  setpriv --pdeathsig KILL unshare --mount --pid --mount-proc --fork --kill-child -- "$@" </dev/null &
  running=$!
  wait "$running" || status=$?
  running=
  return "$status"
}

# TREE DIRECTORY COMMAND...
in_tree() { contained bash tests/fresh/in_tree.sh "$1" "$2" "${environment[@]}" "${@:3}"; }

# "SITE SUITE" of each source of Debian 12 that this machine's apt has: apt itself reads both forms of the files. With
# no lists of packages it names all that it would fetch.
debian_sources() {
  mkdir -p "$work/no-lists/partial"
  apt-get -o Dir::State::lists="$work/no-lists" --print-uris update 2>/dev/null |
    sed -nE "s#^'([^']+)/dists/(bookworm(-updates|-security)?)/main/binary-[a-z0-9]+/.*#\1 \2#p" | sort -u
}

# The environment of every command in a tree: what a bare machine has, and how this one reaches the network.
find_environment() {
  local name registry
  environment=(PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root TERM=dumb LANG=C.UTF-8)
  for name in http_proxy https_proxy no_proxy HTTP_PROXY HTTPS_PROXY NO_PROXY; do
    if [[ -n "${!name:-}" ]]; then environment+=("$name=${!name}"); fi
  done
  registry="$(npm config get registry 2>/dev/null || true)"
  if [[ "$registry" == http* ]]; then environment+=("npm_config_registry=$registry"); fi
  # Node.js has a list of its own.
  if [[ -n "$own_certificates" ]]; then environment+=(NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt); fi
}

# How this machine reaches the network, into the tree: names of hosts, apt's proxies and checks, certificates that the
# operator added. Debian's own keys are in the tree.
set_up_network() {
  local tree="$1" file
  for file in resolv.conf hosts; do
    if [[ -f "/etc/$file" ]]; then cp -L "/etc/$file" "$tree/etc/$file"; fi
  done
  apt-config dump | grep -E '^Acquire::(https?|ForceIPv[46]|Check-Valid-Until|Check-Date)(::| )' |
    grep -vE 'Proxy-?Auto-?Detect|Ssl(Cert|Key)' >"$tree/etc/apt/apt.conf.d/90machine" || true
  while read -r file; do
    if [[ -f "$file" ]]; then install -D -m 644 "$file" "$tree$file"; fi
  done < <(sed -nE 's/^Acquire::https?::(.*::)?CaInfo "(.*)";$/\2/p' "$tree/etc/apt/apt.conf.d/90machine")
  while read -r file; do
    if [[ -n "$file" ]]; then install -D -m 644 "$certificates/$file" "$tree$certificates/$file"; fi
  done <<<"$own_certificates"
}

make_base() {
  local tree="$work/base" log="$logs/base.log" site suite begin="$SECONDS" made=0
  debian_sources >"$work/sources"
  grep -q ' bookworm$' "$work/sources" || fail "apt's sources name no mirror of Debian 12"
  # Repositories of others may have a suite of that name, too; debootstrap takes what Debian signed.
  while read -r site suite; do
    [[ "$suite" == bookworm ]] || continue
    rm -rf --one-file-system "$tree"
    mkdir -m 755 "$tree"
    if contained debootstrap --variant=minbase bookworm "$tree" "$site" >"$log" 2>&1; then made=1; break; fi
  done <"$work/sources"
  [[ "$made" -eq 1 ]] || { tail -n 15 "$log"; fail "debootstrap (log: $log)"; }
  {
    echo "deb $site bookworm main"
    sed -nE 's/^(.*) (bookworm-.*)$/deb \1 \2 main/p' "$work/sources"
  } >"$tree/etc/apt/sources.list"
  set_up_network "$tree"
  find "$tree/dev" -mindepth 1 -delete  # in_tree.sh mounts another
  # No package may start a service.
  printf '#!/bin/sh\nexit 101\n' >"$tree/usr/sbin/policy-rc.d"
  chmod 755 "$tree/usr/sbin/policy-rc.d"

  # shellcheck disable=SC2016
  in_tree "$tree" / DEBIAN_FRONTEND=noninteractive sh -ec '
    if command -v update-ca-certificates >/dev/null; then update-ca-certificates; fi
    apt-get -q update
    apt-get -q -y --no-install-recommends install git make
    apt-get clean
    rm -rf /var/lib/apt/lists/*' >>"$log" 2>&1 || { tail -n 15 "$log"; fail "apt-get install git make (log: $log)"; }
  git clone -q --no-hardlinks . "$tree/root/voxelpipe"
  git -C "$tree/root/voxelpipe" -c advice.detachedHead=false checkout -q --detach "$commit"
  git -C "$tree/root/voxelpipe" remote remove origin
  say "a bare Debian $(cat "$tree/etc/debian_version") with $(grep -c "^Package: " "$tree/var/lib/dpkg/status") packages," \
    "git and make among them, in $((SECONDS - begin)) s"
}

results=()
failed=0
run_command() {
  local name="$1" tree="$work/$1" log="$logs/$1.log" begin status=0
  cp -a --reflink=auto "$work/base" "$tree"
  say "make $name, alone in its own tree"
  begin="$SECONDS"
  in_tree "$tree" /root/voxelpipe make "$name" >"$log" 2>&1 || status=$?
  results+=("make $name $((SECONDS - begin)) s")
  tail -n 15 "$log"
  say "make $name: exit code $status, $((SECONDS - begin)) s (log: $log)"
  [[ "$status" -eq 0 ]] || failed=1
  if [[ "$keep" -eq 0 ]]; then rm -rf --one-file-system "$tree"; fi
}

[[ "$(id -u)" -eq 0 ]] || skip "a Debian tree takes root to make and to enter"
bash tests/support/apt_install.sh debootstrap || skip "debootstrap cannot be installed"
command -v debootstrap >/dev/null || skip "debootstrap is not installed"

commit="$(git rev-parse HEAD)"
logs="$PWD/build-fresh"
mkdir -p "$logs"
parent="${VOXELPIPE_FRESH_DIR:-${TMPDIR:-/tmp}}"
mkdir -p "$parent"
work="$(realpath "$(mktemp -d "$parent/voxelpipe-fresh.XXXXXX")")"
certificates=/usr/local/share/ca-certificates
own_certificates="$(find "$certificates" -name '*.crt' -printf '%P\n' 2>/dev/null || true)"
find_environment
# debootstrap's downloads go where apt's go.
apt_proxy=
eval "$(apt-config shell apt_proxy Acquire::http::Proxy)"
if [[ -z "${http_proxy:-}" && "$apt_proxy" == http* ]]; then export http_proxy="$apt_proxy"; fi

say "commit ${commit:0:12}"
if [[ -n "$(git status --porcelain)" ]]; then
  say "the working tree has changes that are not committed; they are NOT part of this"
fi
make_base
for name in "${commands[@]}"; do run_command "$name"; done
summary="$(printf '%s, ' "${results[@]}")"
if [[ "$failed" -eq 0 ]]; then say "${summary%, }: passed"; else fail "${summary%, }"; fi
