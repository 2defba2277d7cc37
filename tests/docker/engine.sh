# A container engine for docker_test.sh: the one that runs, or a private one for the time of the test. Sourced, bash.
#
# engine_start DIR   sets DOCKER (the command to use, an array); skips (exit 77) with the reason where none can run
# engine_stop        ends the private engine, if one was started, by its pid file
# engine_base_image  makes debian:bookworm-slim available to the engine
# engine_cuda_image  sets CUDA_BASE to what docker/Dockerfile's argument of that name should be

engine_dir=
engine_private=0

skip() {
  echo "SKIPPED: $*"
  exit 77
}

# Debian's own client: another `docker` may stand before it in PATH and lack what the build needs.
engine_client() { if [[ -x /usr/bin/docker ]]; then echo /usr/bin/docker; else command -v docker || true; fi; }

engine_start() {
  engine_dir="$1"
  [[ "${VOXELPIPE_DOCKER_TEST:-0}" == 1 ]] ||
    skip "it compiles the project inside the image, some ten minutes; make docker-test runs it"
  local client
  client="$(engine_client)"
  if [[ -n "$client" ]] && "$client" info >/dev/null 2>&1; then
    DOCKER=("$client")
    echo "engine: the one that runs here"
    return
  fi

  [[ "$(id -u)" -eq 0 ]] || skip "no container engine runs, and starting one needs root"
  command -v apt-get >/dev/null || skip "no container engine runs, and this system has no apt to install one"
  mkdir -p "$engine_dir"
  local free_kib
  free_kib="$(df --output=avail -k "$engine_dir" | tail -n 1)"
  [[ "$free_kib" -ge $((6 * 1024 * 1024)) ]] || skip "$engine_dir has $((free_kib / 1024)) MiB free, 6144 are needed"
  bash tests/support/apt_install.sh docker.io debootstrap iptables
  [[ -x /usr/sbin/dockerd ]] || skip "docker.io could not be installed"

  # No bridge, no firewall rules, no service manager: containers use the host's network.
  /usr/sbin/dockerd --data-root "$engine_dir/data" --exec-root "$engine_dir/exec" --pidfile "$engine_dir/dockerd.pid" \
    -H "unix://$engine_dir/docker.sock" --bridge=none --iptables=false --ip6tables=false --ip-forward=false \
    --ip-masq=false >"$engine_dir/dockerd.log" 2>&1 </dev/null &
  engine_private=1
  DOCKER=(/usr/bin/docker -H "unix://$engine_dir/docker.sock")
  local i
  for i in $(seq 120); do
    if "${DOCKER[@]}" info >/dev/null 2>&1; then
      echo "engine: a private one in $engine_dir, storage $("${DOCKER[@]}" info -f '{{.Driver}}')"
      return
    fi
    sleep 0.5
  done
  tail -n 20 "$engine_dir/dockerd.log"
  skip "dockerd does not come up on this machine (its last lines are above)"
}

engine_stop() {
  [[ "$engine_private" -eq 1 ]] || return 0
  local pid i
  pid="$(cat "$engine_dir/dockerd.pid" 2>/dev/null || true)"
  if [[ -n "$pid" ]]; then
    kill -TERM "$pid" 2>/dev/null || true
    for i in $(seq 100); do
      kill -0 "$pid" 2>/dev/null || break
      sleep 0.2
    done
    kill -KILL "$pid" 2>/dev/null || true
  fi
  umount "$engine_dir/exec/netns/default" 2>/dev/null || true
  engine_private=0
}

engine_base_image() {
  local image=debian:bookworm-slim mirror root
  "${DOCKER[@]}" image inspect "$image" >/dev/null 2>&1 && return
  if [[ "$engine_private" -eq 0 ]]; then
    "${DOCKER[@]}" pull -q "$image" && return
  fi
  # No image registry: make the same thing from the mirror that this machine's apt uses.
  [[ "$(id -u)" -eq 0 ]] || skip "$image cannot be pulled, and making it needs root"
  bash tests/support/apt_install.sh debootstrap
  mirror="$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' 'Codename: bookworm' 2>/dev/null | head -n 1)"
  [[ -n "$mirror" ]] || skip "apt's sources name no Debian 12 mirror to make $image from"
  root="$engine_dir/rootfs"
  rm -rf "$root"
  mkdir -p "$root"
  echo "engine: making $image with debootstrap"
  debootstrap --variant=minbase bookworm "$root" "$mirror" >"$engine_dir/debootstrap.log" 2>&1 ||
    { tail -n 20 "$engine_dir/debootstrap.log"; skip "debootstrap failed (its last lines are above)"; }
  rm -rf "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/*
  tar -C "$root" -c . | "${DOCKER[@]}" import - "$image" >/dev/null
  rm -rf "$root"
}

# Without the packages that the Dockerfile takes from NVIDIA: the host's toolkit, if it has one, on top of the base image.
engine_cuda_image() {
  CUDA_BASE="${VOXELPIPE_DOCKER_CUDA_BASE:-cuda-toolkit}"
  local toolkit=/usr/local/cuda context
  [[ "$CUDA_BASE" == cuda-toolkit && -x $toolkit/bin/nvcc ]] || return 0
  CUDA_BASE=voxelpipe-test:cuda-base
  context="$engine_dir/cuda-base"
  rm -rf "$context"
  mkdir -p "$context/cuda/lib64"
  echo "engine: making $CUDA_BASE with the toolkit in $toolkit"
  # -L: parts of a toolkit may be links to another place; nvcc looks under targets/ too.
  cp -rL "$toolkit/bin" "$toolkit/nvvm" "$toolkit/include" "$context/cuda/"
  cp -L "$toolkit"/lib64/libcudart* "$toolkit"/lib64/libcudadevrt.a "$context/cuda/lib64/"
  mkdir -p "$context/cuda/targets/x86_64-linux"
  ln -s ../../include ../../lib64 "$context/cuda/targets/x86_64-linux/"
  ln -s lib64 "$context/cuda/lib"
  ln -s ../../lib64 "$context/cuda/targets/x86_64-linux/lib"
  printf '%s\n' 'FROM debian:bookworm-slim' 'COPY cuda /usr/local/cuda' >"$context/Dockerfile"
  DOCKER_BUILDKIT=1 "${DOCKER[@]}" build --network host -q -t "$CUDA_BASE" "$context" >/dev/null
  rm -rf "$context"
}
