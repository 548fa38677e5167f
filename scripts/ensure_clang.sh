#!/bin/sh
# See to a Clang with sanitizers, which compiles the native code's own tests. Never fails: without it they skip, loudly.
# Clang 17 is the first that knows all the vector builtins used; of those that apt offers, the newest is taken.
python=${1:-python3}
has_clang() { "$python" "$(dirname "$0")/../tests/native_build.py" --has-clang >/dev/null 2>&1; }

has_clang && exit 0
as_root=
[ "$(id -u)" -eq 0 ] || as_root="sudo -n"
if command -v apt-get >/dev/null 2>&1; then
    $as_root apt-get update -qq
    version=$(apt-cache search --names-only '^libclang-rt-[0-9]+-dev$' | sed 's/^libclang-rt-\([0-9]*\)-dev.*/\1/' | sort -n | tail -1)
    if [ "${version:-0}" -ge 17 ]; then
        echo "installing clang-$version libclang-rt-$version-dev, for the tests of native code"
        $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
            "clang-$version" "libclang-rt-$version-dev" >/dev/null
    fi
fi
has_clang || echo "warning: no Clang from 17 on with sanitizers here; as root: apt-get install clang-19 libclang-rt-19-dev" >&2
exit 0
