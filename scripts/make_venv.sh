#!/bin/sh
# Make a virtual environment with the newest Python from 3.11 up that this machine has: make_venv.sh FOLDER
set -eu
folder=$1

fits() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

python=
for name in python3 python3.13 python3.12 python3.11; do
    if fits "$name"; then python=$name; break; fi
done
if [ -z "$python" ]; then
    echo "warpvis needs Python 3.11 or later, and this machine has none: install python3.11 or later" >&2
    exit 1
fi

rm -rf "$folder"
if ! "$python" -m venv "$folder" 2>/dev/null; then
    # Debian and Ubuntu pack venv apart from Python.
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    package="python$version-venv"
    echo "installing $package, which Debian and Ubuntu pack apart from Python"
    as_root=
    [ "$(id -u)" -eq 0 ] || as_root="sudo -n"
    $as_root apt-get update -qq && $as_root apt-get install -y -qq "$package" >/dev/null || {
        echo "could not install it: as root, apt-get install $package, then run make again" >&2
        exit 1
    }
    rm -rf "$folder"
    "$python" -m venv "$folder"
fi
