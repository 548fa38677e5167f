#!/bin/sh
# Create a virtual environment with the first suitable Python (3.11 or later): make_venv.sh FOLDER
set -eu
folder=$1

fits() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

python=
for name in python3 python3.14 python3.13 python3.12 python3.11; do
    if fits "$name"; then python=$name; break; fi
done
if [ -z "$python" ]; then
    echo "warpvis needs Python 3.11 or later, which was not found: install python3.11 or later" >&2
    exit 1
fi

rm -rf "$folder"
if ! "$python" -m venv "$folder" 2>/dev/null; then
    # Debian and Ubuntu package venv separately from Python.
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    "$(dirname "$0")/apt_install.sh" "virtual environments" "python$version-venv" || exit 1
    rm -rf "$folder"
    "$python" -m venv "$folder"
fi
