#!/bin/sh
# See to EGL by Mesa, which the tests that compare with mujoco.Renderer need. Never fails: without it they skip, loudly.
has_egl() { ldconfig -p 2>/dev/null | grep -q 'libEGL\.so\.1' && ls /usr/share/glvnd/egl_vendor.d/*mesa* >/dev/null 2>&1; }

has_egl && exit 0
packages="libegl1 libegl-mesa0 libgl1-mesa-dri"
as_root=
[ "$(id -u)" -eq 0 ] || as_root="sudo -n"
if command -v apt-get >/dev/null 2>&1; then
    echo "installing $packages, for the tests that compare with mujoco.Renderer"
    $as_root apt-get update -qq && $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $packages >/dev/null
fi
has_egl || echo "warning: no EGL here; as root: apt-get install $packages" >&2
exit 0
