#!/bin/sh
# Install the libraries that `make bench` compares with, where the platform supports them: ensure_peers.sh PYTHON
# Never fails: the table lists missing libraries.
python=$1
for peer in open3d mitsuba; do
    "$python" -c "import importlib.util as u, sys; sys.exit(u.find_spec('$peer') is None)" ||
        "$python" -m pip install --quiet --disable-pip-version-check -c constraints.txt "$peer" ||
        echo "warning: could not install $peer" >&2
done

# Open3D needs libusb, and Mitsuba LLVM's library.
packages=
ldconfig -p | grep -q 'libusb-1\.0\.so\.0' || packages="libusb-1.0-0"
ldconfig -p | grep -q 'libLLVM' || packages="$packages llvm"
[ -z "$packages" ] || "$(dirname "$0")/apt_install.sh" "the peers of the benchmark" $packages
exit 0
