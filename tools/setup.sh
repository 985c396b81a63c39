#!/usr/bin/env bash
# Usage: tools/setup.sh [PACKAGE …]
# Installs what a Debian machine lacks to build Stoop and to draw without a GPU: a C++ compiler, cmake and SQLite for
# PROJ, Vulkan's loader with Mesa's software driver, what the window loads when it opens (X11 or Wayland; nothing of it
# is needed to build), and Rust. Does nothing, and needs no network, where all is there.
set -euo pipefail
export PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"

# winit opens these by name at run time: libX11, libX11-xcb, libXcursor, libXi (libxcb comes with them), libxkbcommon and
# libxkbcommon-x11 (with the keyboards' descriptions), libwayland-client.
window=(libx11-6 libx11-xcb1 libxcursor1 libxi6 libxkbcommon0 libxkbcommon-x11-0 libwayland-client0)
packages=(build-essential ca-certificates cmake pkg-config sqlite3 libsqlite3-dev libvulkan1 mesa-vulkan-drivers
    "${window[@]}" "$@")
rust_least=1.95

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi
}

install() {
    as_root apt-get -o DPkg::Lock::Timeout=400 update -q
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=400 install -y -q "$@"
}

missing=()
for package in "${packages[@]}"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
if [ ${#missing[@]} -gt 0 ]; then
    if ! command -v apt-get >/dev/null; then
        echo "setup: this is no Debian; install what matches: ${missing[*]}" >&2
        exit 1
    fi
    install "${missing[@]}"
fi

rust_is_new_enough() {
    command -v cargo >/dev/null || return 1
    local have
    have=$(cargo --version | cut -d' ' -f2)
    [ "$(printf '%s\n' "$rust_least" "$have" | sort -V | head -n 1)" = "$rust_least" ]
}

if ! rust_is_new_enough; then
    # Debian 13 and later have rustup; it puts a current toolchain into the home folder.
    command -v rustup >/dev/null || install rustup || true
    if command -v rustup >/dev/null; then
        rustup toolchain install stable
        rustup default stable
    fi
fi
if ! rust_is_new_enough; then
    echo "setup: Rust $rust_least or newer is needed and this Debian has no rustup: install it by its own script" \
        "(see rust-lang.org), then run this again" >&2
    exit 1
fi
