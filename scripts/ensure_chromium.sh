#!/bin/sh
# See to Debian's Chromium, in which the live viewer is tested. Never fails: without it these tests skip, loudly.
has_chromium() { command -v chromium >/dev/null 2>&1; }

has_chromium && exit 0
as_root=
[ "$(id -u)" -eq 0 ] || as_root="sudo -n"
if command -v apt-get >/dev/null 2>&1; then
    echo "installing chromium, for the tests of the live viewer"
    $as_root apt-get update -qq && $as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends chromium >/dev/null
fi
has_chromium || echo "warning: no chromium here; as root: apt-get install chromium" >&2
exit 0
