#!/bin/sh
# Install Mesa's EGL, which tests that compare with mujoco.Renderer need. Never fails: without it they are skipped.
ldconfig -p 2>/dev/null | grep -q 'libEGL\.so\.1' && ls /usr/share/glvnd/egl_vendor.d/*mesa* >/dev/null 2>&1 && exit 0
"$(dirname "$0")/apt_install.sh" "tests that compare with mujoco.Renderer" libegl1 libegl-mesa0 libgl1-mesa-dri
exit 0
