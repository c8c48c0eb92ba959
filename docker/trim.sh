#!/bin/sh
# trim.sh VENV: remove what no part imports, then compile the rest, for a file system that is read
# only.
set -eu
cd "$1"/lib/python3*/site-packages
find . -type d \( -name tests -o -name sample_data \) -prune -exec rm -rf {} +
find . -type f \( -name '*.pyi' -o -name '*.pyx' -o -name '*.pxd' -o -name '*.[ach]' -o \
    -name '*.cpp' \) -delete
# Of MAVLink's dialects one is spoken; lxml only generates dialects.
find pymavlink/dialects -mindepth 1 -name '*.py' ! -path '*/v20/ardupilotmega.py' \
    ! -name __init__.py -delete
rm -rf pymavlink/dialects/v10 pymavlink/generator pymavlink/dfindexer pymavlink/tools lxml lxml-*
rm -rf zstandard/_cffi.* # of its two backends the one that is not used
rm -rf fontTools/varLib fontTools/feaLib fontTools/designspaceLib fontTools/cu2qu fontTools/qu2cu
# Of pygments, which rich wants, no language is shown; no picture is AVIF.
find pygments/lexers -name '*.py' ! -name __init__.py ! -name _mapping.py -delete
rm -rf pillow.libs/libavif* PIL/_avif.* numpy/_core/_simd.*
# Symbols for debuggers; not of libraries that their wheels have patched (*.libs, numpy).
for package in zenoh kiwisolver fontTools lz4 yaml zstandard cryptography fastcrc pydantic_core; do
    [ ! -d "$package" ] || find "$package" -name '*.so' -exec strip --strip-unneeded {} +
done
python3 -m compileall -q --invalidation-mode unchecked-hash . || true # templates do not compile
