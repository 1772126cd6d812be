#!/bin/sh
# Installs what cargo built: headers, libraries, pkg-config and CMake files. Linux and macOS.
#
#     cargo build --release --package granular-id-c
#     rust/c/install.sh /usr/local        # or another prefix; a second argument names the folder that holds the libraries
set -eu
here=$(cd "$(dirname "$0")" && pwd)
prefix=${1:?usage: install.sh PREFIX [BUILD]}
build=${2:-${CARGO_TARGET_DIR:-$here/../../target}/release}
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' "$here/../../Cargo.toml" | head -n 1)

found=
for library in libgranular_id_c.a libgranular_id_c.so libgranular_id_c.dylib; do
    test ! -e "$build/$library" || found="$found $library"
done
if test -z "$found"; then
    echo "install.sh: no libgranular_id_c in $build" >&2
    echo "cargo build --release --package granular-id-c makes it; install.sh PREFIX BUILD takes another folder" >&2
    exit 1
fi

mkdir -p "$prefix/include" "$prefix/lib/pkgconfig" "$prefix/lib/cmake/granular_id"
cp "$here/include/granular_id.h" "$here/include/granular_id.hpp" "$prefix/include"
for library in $found; do
    cp "$build/$library" "$prefix/lib"
done
# cargo names the folder of the build there. Not tried: nothing has run on macOS.
dylib=$prefix/lib/libgranular_id_c.dylib
test ! -e "$dylib" || install_name_tool -id @rpath/libgranular_id_c.dylib "$dylib"
sed "s/@VERSION@/$version/" "$here/granular_id.pc.in" > "$prefix/lib/pkgconfig/granular_id.pc"
cp "$here/granular_id-config.cmake" "$prefix/lib/cmake/granular_id"
sed "s/@VERSION@/$version/" "$here/granular_id-config-version.cmake.in" \
    > "$prefix/lib/cmake/granular_id/granular_id-config-version.cmake"
echo "installed granular_id $version into $prefix"
