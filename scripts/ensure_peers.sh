#!/bin/sh
# Install the peers that `make bench` compares with, as far as this machine takes them: ensure_peers.sh PYTHON
# Never fails: a peer that is missing is named in the table.
python=$1
as_root=
[ "$(id -u)" -eq 0 ] || as_root="sudo -n"

for peer in open3d mitsuba; do
    "$python" -c "import importlib.util as u, sys; sys.exit(u.find_spec('$peer') is None)" ||
        "$python" -m pip install --quiet --disable-pip-version-check -c constraints.txt "$peer" ||
        echo "warning: could not install $peer" >&2
done

# Open3D needs libusb, and Mitsuba LLVM's library.
packages=
ldconfig -p | grep -q 'libusb-1\.0\.so\.0' || packages="libusb-1.0-0"
ldconfig -p | grep -q 'libLLVM' || packages="$packages llvm"
if [ -n "$packages" ] && command -v apt-get >/dev/null 2>&1; then
    echo "installing $packages, for the peers"
    $as_root apt-get update -qq && $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $packages >/dev/null
fi
exit 0
