#!/usr/bin/env bash
# Runs docker/systemd/voxelpiped.service under a real systemd, in namespaces of its own with no other unit: the start, a
# call, a file for a process that loads meshes, the reload, the end under load, a server that is stuck. It mounts over
# parts of its own view of the machine, so it runs only as root and when VOXELPIPE_SYSTEMD_TEST=1 asks for it.
#
# usage: systemd_run.sh REPOSITORY PROGRAMS_DIR
# Exit: 0 passed, 77 skipped with a printed reason, anything else failed.
set -euo pipefail
repository="$(realpath "$1")" programs="$(realpath "$2")"
skip() { echo "SKIPPED: $*"; exit 77; }
fail() { echo "FAILED: $*" >&2; cat "$work/server.log" "$work/systemd.log" >&2 || true; exit 1; }
[[ "${VOXELPIPE_SYSTEMD_TEST:-0}" == 1 ]] || skip "it starts a systemd; VOXELPIPE_SYSTEMD_TEST=1 runs it"
[[ "$(id -u)" -eq 0 ]] || skip "it needs root"
[[ -x /lib/systemd/systemd ]] || skip "systemd is not installed"

work="$(mktemp -d)"
manager=
clean_up() {
  if [[ -n "$manager" ]]; then kill -KILL "$manager" 2>/dev/null || true; fi
  rm -rf "$work"
}
trap clean_up EXIT

mkdir -p "$work/units/voxelpiped.service.d"
bin=/usr/local/lib/voxelpipe-test # in the namespace, where a user without rights finds it
sed -e "s|@bindir@|$bin|" -e "s|/etc/voxelpipe/voxelpiped.env|$work/voxelpiped.env|" \
  "$repository/docker/systemd/voxelpiped.service.in" >"$work/units/voxelpiped.service"
# Its ordering names units that are not here; the watchdog is quick. All else is the unit's.
printf '%s\n' '[Unit]' 'DefaultDependencies=no' '[Service]' "StandardOutput=append:$work/server.log" \
  "StandardError=append:$work/server.log" 'WatchdogSec=3' >"$work/units/voxelpiped.service.d/test.conf"
for name in default basic sysinit shutdown network-online multi-user umount final; do
  printf '[Unit]\nDefaultDependencies=no\n' >"$work/units/$name.target"
done
python() { bash "$repository/tests/support/python.sh" "$@"; }
port="$(python -c 'import socket; print(socket.create_server(("127.0.0.1", 0)).getsockname()[1])')"
printf '%s\n' "VOXELPIPE_LISTEN=127.0.0.1:$port" VOXELPIPE_LAME_DUCK_MS=3000 VOXELPIPE_ISOLATE_LOADING=on \
  >"$work/voxelpiped.env"

cat >"$work/namespace.sh" <<END
set -e
mount --make-rprivate /
for folder in /run /usr/local/lib /etc/systemd /opt; do mount -t tmpfs tmpfs \$folder; done
install -D -t $bin "$programs/voxelpiped"
umount -l /sys/fs/cgroup/* 2>/dev/null || true
umount -l /sys/fs/cgroup 2>/dev/null || true
mount -t cgroup2 cgroup2 /sys/fs/cgroup
exec env -i PATH="\$PATH" container=test SYSTEMD_UNIT_PATH="$work/units" SYSTEMD_GENERATOR_PATH=/nonexistent \
  /lib/systemd/systemd --system --log-target=console
END
unshare --pid --fork --kill-child --mount --cgroup --mount-proc bash "$work/namespace.sh" >"$work/systemd.log" 2>&1 &
parent=$!
for _ in $(seq 100); do
  manager="$(pgrep -P "$parent" || true)"
  if [[ -n "$manager" ]] && nsenter -t "$manager" -m -p -C test -S /run/systemd/private; then break; fi
  if ! kill -0 "$parent" 2>/dev/null; then
    grep -q 'not permitted\|denied' "$work/systemd.log" && skip "no namespaces here: $(tail -n 1 "$work/systemd.log")"
    fail "systemd does not start"
  fi
  sleep 0.1
done
systemctl() { nsenter -t "$manager" -m -p -C systemctl "$@"; }
shown() { systemctl show voxelpiped --value -p "$1"; }
voxelpipe="$programs/voxelpipe"
address="127.0.0.1:$port"

systemctl start voxelpiped || fail "the unit does not start"
[[ "$(shown ActiveState) $(shown StatusText)" == "active serving on $address" ]] || fail "it is not ready"
python "$repository/tests/support/make_ball.py" "$work/ball.glb"
python "$repository/tests/docker/make_3mf.py" "$work/corner.3mf"
for mesh in ball.glb corner.3mf; do # the second one by a process that loads meshes, in its sandbox
  "$voxelpipe" voxelize "$work/$mesh" --server "$address" --resolution 32 --json >"$work/there.json" || fail "$mesh"
  "$voxelpipe" voxelize "$work/$mesh" --resolution 32 --json >"$work/here.json"
  for one in there here; do grep -o '"hash":[^,}]*' "$work/$one.json" >"$work/$one"; done
  diff "$work/there" "$work/here" || fail "$mesh: other bytes"
done
systemctl reload voxelpiped || fail "reload"

# The end under load: calls that begin before the lame duck is over all end well.
"$voxelpipe" bench "$work/ball.glb" --server "$address" --concurrency 8 --duration 3 --resolution 32 \
  --max-error-rate 0 --json >"$work/bench.json" &
load=$!
sleep 1
systemctl stop voxelpiped || fail "stop"
wait "$load" || fail "calls were lost: $(cat "$work/bench.json")"
[[ "$(shown Result) $(shown ExecMainStatus) $(shown NRestarts)" == "success 0 0" ]] || fail "the end: $(shown Result)"

# One that is stuck.
systemctl start voxelpiped || fail "the second start"
systemctl kill -s STOP --kill-whom=main voxelpiped
for _ in $(seq 200); do
  [[ "$(shown NRestarts)" == 0 ]] || break
  sleep 0.1
done
[[ "$(shown NRestarts)" == 1 ]] || fail "a stuck server is not restarted"
for _ in $(seq 100); do
  [[ "$(shown StatusText)" != "serving on $address" ]] || break
  sleep 0.1
done
"$voxelpipe" server-info --server "$address" >"$work/info" || fail "the restarted server does not answer"

# Certificates and tokens that a group may read, as docker/README.md has it; here with a group that there is.
group=games secrets=/opt/voxelpipe-test # in the namespace
mkdir "$work/secrets"
openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 1 -subj /CN=localhost \
  -addext subjectAltName=DNS:localhost -keyout "$work/secrets/tls.key" -out "$work/secrets/tls.crt" 2>/dev/null
token=a-token-of-the-test-of-systemd
echo "{\"clients\": [{\"name\": \"test\", \"role\": \"user\", \"token\": \"$token\"}]}" >"$work/secrets/tokens.json"
nsenter -t "$manager" -m install -D -g "$group" -m 640 -t "$secrets" "$work"/secrets/*
awk '/^```ini$/ {inside = 1; next} /^```$/ {inside = 0} inside' "$repository/docker/README.md" |
  sed -e "s|/etc/voxelpipe|$secrets|g" -e "s|^SupplementaryGroups=.*|SupplementaryGroups=$group|" \
    >"$work/units/voxelpiped.service.d/secrets.conf"
systemctl daemon-reload
systemctl restart voxelpiped || fail "the start with TLS and tokens"
access=(--server "localhost:$port" --tls-ca "$work/secrets/tls.crt")
VOXELPIPE_TOKEN="$token" "$voxelpipe" server-info "${access[@]}" >"$work/info" || fail "a call with TLS and a token"
if "$voxelpipe" server-info "${access[@]}" >"$work/info" 2>&1; then fail "a call without a token passes"; fi
systemctl stop voxelpiped || fail "the last stop"
echo "PASSED with $(/lib/systemd/systemd --version | head -n 1): start, calls, reload, end, watchdog, TLS and tokens"
