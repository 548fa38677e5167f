#!/bin/sh
# Install packages of Debian or Ubuntu, as root only: apt_install.sh PURPOSE PACKAGE...
# Any other user gets the command to run. Exits with 1 if the packages were not installed.
purpose=$1
shift
if ! command -v apt-get >/dev/null 2>&1; then
    echo "warning: $purpose: this system has no apt-get; install $*" >&2
    exit 1
fi
if [ "$(id -u)" -ne 0 ]; then
    echo "warning: $purpose: run 'sudo apt-get install $*'" >&2
    exit 1
fi
echo "installing $* for $purpose"
apt-get update -qq
DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
