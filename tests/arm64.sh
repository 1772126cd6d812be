#!/usr/bin/env bash
# The Rust tests on arm64, by qemu and Debian's own compiler: where rustup has no aarch64-unknown-linux-gnu to give.
# As root on amd64 Debian; takes 400 MB of packages into target/debian, and nothing into the system. Arguments go to
# `cargo test`; without any: --lib --tests.
set -euo pipefail
repo=$(cd "$(dirname "$0")/.." && pwd)
box=$repo/target/debian
root=$box/root
cargo fetch --quiet --manifest-path "$repo/Cargo.toml"

if [ ! -e "$box/ready" ]; then
  rm -rf "$box"
  mkdir -p "$box"/{etc/apt.conf.d,etc/preferences.d,lists/partial,cache/archives/partial} "$root"/{dev,proc,tmp,repo,cargo} \
    "$root"/usr/{bin,sbin,lib,lib64}
  for folder in bin sbin lib lib64; do ln -s "usr/$folder" "$root/$folder"; done
  # From where this machine has its own packages.
  site=$(apt-get indextargets --format '$(SITE)' | head -n 1)
  echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $site trixie main" > "$box/etc/sources.list"
  touch "$box/status"
  cat > "$box/apt.conf" <<CONF
Dir "$box"; Dir::Etc "$box/etc"; Dir::State "$box"; Dir::State::status "$box/status"; Dir::Cache "$box/cache";
APT::Architecture "amd64"; APT::Architectures { "amd64"; "arm64"; };
APT::Install-Recommends "false"; APT::Sandbox::User "root"; Acquire::Languages "none";
CONF
  export APT_CONFIG=$box/apt.conf
  apt-get update -qq
  # Stable Debian's newer Rust. The standard library of arm64 has to be that of the compiler, which runs on this machine's
  # processor.
  apt-get install -qq --yes --download-only {rustc,cargo}-web libstd-rust-web-dev{,:arm64} \
    gcc libc6-dev gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user bash coreutils
  for package in "$box"/cache/archives/*.deb; do dpkg-deb -x "$package" "$root"; done
  ln -sf gcc "$root/usr/bin/cc"
  touch "$box/ready"
fi

[ $# -gt 0 ] || set -- --lib --tests
# Mounts of its own, which end with it.
exec unshare --mount env root="$root" repo="$repo" home="${CARGO_HOME:-$HOME/.cargo}" bash -euc '
  mount --bind /dev "$root/dev"; mount --bind /proc "$root/proc"
  mount --bind "$repo" "$root/repo"; mount --bind "$home" "$root/cargo"
  exec chroot "$root" /usr/bin/env -i --chdir=/repo PATH=/usr/bin HOME=/tmp CARGO_HOME=/cargo CARGO_TARGET_DIR=/repo/target/arm64 \
    CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc \
    CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64 -L /usr/aarch64-linux-gnu" \
    cargo test --offline --target aarch64-unknown-linux-gnu "$@"' -- "$@"
