#!/bin/sh
# Install Chromium, in which the live viewer and the site are tested. Never fails: without it these tests are skipped.
command -v chromium >/dev/null 2>&1 && exit 0
"$(dirname "$0")/apt_install.sh" "tests of the live viewer" chromium
exit 0
