#!/bin/sh
# Install a Clang with sanitizers, which the tests of native code need: ensure_clang.sh PYTHON
# Never fails: without it, these tests are skipped. Clang 17 is the first version with all required vector builtins.
here=$(dirname "$0")
"${1:-python3}" "$here/../tests/native_build.py" --has-clang >/dev/null 2>&1 && exit 0
[ "$(id -u)" -ne 0 ] || apt-get update -qq  # lists of packages may be missing, as in a container
version=$(apt-cache search --names-only '^libclang-rt-[0-9]+-dev$' 2>/dev/null |
    sed 's/^libclang-rt-\([0-9]*\)-dev.*/\1/' | sort -n | tail -1)
[ "${version:-0}" -ge 17 ] || version=19
"$here/apt_install.sh" "tests of native code" "clang-$version" "libclang-rt-$version-dev"
exit 0
