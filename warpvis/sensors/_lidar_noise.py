# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Noise of lidars: range errors, returns that are too weak, and returns from rain."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import as_floats
from warpvis.cameras.pinhole import Camera
from warpvis.cameras.rays import Rays
from warpvis.core.arrays import check_out, take_out
from warpvis.core.checks import as_items, check_flag, check_number, is_number
from warpvis.core.threads import launch_images, write_fields
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, CameraError
from warpvis.rendering import DepthSensor, Exposure, check_word, next_frame, rays_on_device, view_numbers
from warpvis.scene import Scene
from warpvis.sensors._echoes import Reflectivity, Returns, reflectivities, require_rays
from warpvis.sensors._glare import prepare_glare
from warpvis.sensors.depth._base import check_positive, kernel_images

if TYPE_CHECKING:
    from warpvis.kernels.sensors.lidar_noise import Glare, LidarModel
    from warpvis.kernels.sensors.noise import SensorInputs

_DECIBELS = 10.0 / math.log(10.0)
_LOG2_E = math.log2(math.e)
_LIMITED = "weak_sigma", "power_sigma", "rain", "glare"
_MAX_GLARE_ANGLE = 0.2  # beyond it, all rays are neighbors of all others; angles in degrees are greater
_ERRORS = "sigma", "sigma_growth", "weak_sigma", "resolution", "ring_sigma", "power_sigma"
_UNITS = dict.fromkeys(("sigma", "weak_sigma", "resolution", "ring_sigma"), " of m") | {"rain": " of mm/h"}
_PROBABILITIES = "dropout", "false_returns"
_FRACTIONS = *_PROBABILITIES, "glare"


@dataclass(frozen=True)
class LidarNoise(DepthSensor):
    """Noise of a lidar: a sensor for `warpvis.cameras.Rays`, such as those of `warpvis.sensors.lidars`.

    The measured range of a surface at range r [m] is r, plus the constant error of the ray's ring, plus normal noise
    with variance ``sigma^2 + (sigma_growth r)^2 + weak_sigma^2 P0 / P``, rounded to a multiple of `resolution`. P is
    the received power, ``reflectivity cos(incidence) / r^2 exp(-2 attenuation r)``, and P0 the limit of detection, the
    power of a surface with `detection_reflectivity` at `detection_range` in clear air.

    A ray has no range if one of these conditions is true; the first gives its `Reason`: it hits nothing (EMPTY); it is
    lost with probability `dropout` (DROPOUT); its power is too low because of the angle of incidence (GRAZING), or
    because the surface is dark or far (DROPOUT); the measured range is outside of `near` and `far` of the rays (RANGE).

    Glare follows Gump et al., "Ghosts in the Point Clouds: De-glaring LiDAR in the Transient Domain" (CVPR 2026), as a
    spread function of light that is the same everywhere in the image, but the brightest surface counts alone.

    Directions are exact: an angular error of the device is not modeled. By default, a lidar has no errors.
    """

    sigma: float = 0.0
    """Standard deviation of the range [m]."""
    sigma_growth: float = 0.0
    """Standard deviation of the range, relative to the range."""
    weak_sigma: float = 0.0
    """Standard deviation of the range at the limit of detection [m]: the part that decreases with the root of power,
    about as in the first data sheet of Ouster's OS1 (10, 3 and 1.5 cm at signal-to-noise ratios of 12, 100 and 250).
    Requires `detection_range`."""
    resolution: float = 0.0
    """Step of reported ranges [m]; 0 for none."""
    ring_sigma: float = 0.0
    """Standard deviation of the constant range error of each ring [m], which depends only on the seed and the ring."""
    ring_offsets: Sequence[float] | None = None
    """Constant range errors of rings 0, 1, ... [m], such as the result of a calibration."""
    dropout: float = 0.0
    """Probability that a ray is lost, from 0 to 1."""
    detection_range: float = math.inf
    """Range at which a surface of `detection_reflectivity` is just detected at normal incidence in clear air [m]; data
    sheets have it as "120 m at 10 %". Infinite if detection does not depend on power."""
    detection_reflectivity: float = 0.1
    """Reflectivity of the surface for which `detection_range` is given."""
    power_sigma: float = 0.0
    """Standard deviation of the received power's noise, relative to the limit of detection: the higher, the more
    gradually surfaces disappear. At `detection_range`, half of the rays are detected. Requires `detection_range`."""
    reflectivity: Reflectivity = 1.0
    """Reflectivity: one value for all objects, a mapping from object names to values (1 for others), or values in scene
    order. Retro-reflectors have more than 1."""
    rain: float = 0.0
    """Rain rate [mm/h], which weakens returns. Requires `detection_range`."""
    visibility: float = math.inf
    """Meteorological visibility in fog [m], which weakens returns. Requires `detection_range`."""
    false_returns: float = 0.0
    """Probability of a return from a drop of rain or fog, from 0 to 1. Ranges of these returns have an exponential
    distribution with the mean `false_range`; those behind the surface, or out of range, have no effect. They have
    depth (VALID), also where there is no surface."""
    false_range: float = 3.0
    """Mean range of returns from drops [m]."""
    glare: float = 0.0
    """Blooming around retro-reflectors: the fraction of a surface's power that rays next to it receive, from 0 to 1. It
    falls off with the angle between the rays, as a Gaussian. A ray reports the range of the brightest surface whose
    light it receives, also where it hits nothing. Requires `detection_range`, and SciPy."""
    glare_angle: float = 0.01
    """Standard deviation of that angle [rad]; light from beyond three times as far is ignored."""

    takes_motion: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in (*_ERRORS, "rain"):
            _check_size(getattr(self, name), name, _UNITS.get(name, ""))
        for name in _FRACTIONS:
            check_number(getattr(self, name), name, minimum=0.0, maximum=1.0)
        for name in ("detection_range", "visibility"):
            _check_distance(getattr(self, name), name)
        check_positive(self.detection_reflectivity, "detection_reflectivity")
        check_positive(self.false_range, "false_range", "m")
        check_positive(self.glare_angle, "glare_angle", "rad")
        if self.glare_angle > _MAX_GLARE_ANGLE:
            raise ArrayError(f"glare_angle must be in radians, at most {_MAX_GLARE_ANGLE}, got {self.glare_angle}")
        if self.ring_offsets is not None:
            offsets = as_items(self.ring_offsets, "ring_offsets")
            checked = tuple(check_number(offset, f"ring_offsets[{ring}]") for ring, offset in enumerate(offsets))
            object.__setattr__(self, "ring_offsets", checked)
        if self.detection_range == math.inf:
            useless = [name for name in _LIMITED if getattr(self, name)]
            useless += ["visibility"] if self.visibility < math.inf else []
            if useless:
                raise ArrayError(f"detection_range must be a number of m if {useless[0]} is given, got inf")

    @property
    def attenuation(self) -> float:
        """Extinction coefficient of rain and fog [1/m].

        Rain has 1.076 R^0.67 dB/km at R mm/h (Carbonneau and Wisely 1998; ITU-R P.1814), and fog ln(50) / visibility
        (Koschmieder 1924: contrast falls to 2 % at that distance), for any wavelength.
        """
        rain = 1.076 * self.rain**0.67 / (1000.0 * _DECIBELS)
        return rain + math.log(50.0) / self.visibility

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read to compute received power."""
        if self.detection_range == math.inf:
            return ()
        plain = is_number(self.reflectivity) and self.reflectivity == 1.0
        return ("normals",) if plain else ("normals", "segmentation")

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel [B]: cosines of incidence of a moving lidar, and power."""
        return (4 if self.needs else 0) + (4 if self.glare else 0)

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the rays if they can be used with the sensor and the scene.

        Raises:
            WarpvisError: If `camera` is not `warpvis.cameras.Rays`, has no rings although they have errors, or the
                scene lacks an object of `reflectivity`.
        """
        if not isinstance(camera, Rays):
            raise CameraError(
                "camera of LidarNoise must be warpvis.cameras.Rays, such as warpvis.sensors.lidars.vlp16(), got "
                f"{type(camera).__name__}"
            )
        self._check_rings(camera)
        reflectivities(scene, self.reflectivity)
        return cast(Camera, camera)

    def depth_sigma(self, depth: ArrayLike, camera: object) -> NDArray[np.float64]:
        """Return the standard deviation of range at normal incidence, for the darkest surface."""
        r = as_floats(depth, "depth")
        values = self.reflectivity.values() if isinstance(self.reflectivity, Mapping) else self.reflectivity
        darkest = float(np.min([*values] if isinstance(values, Iterable) else values, initial=1.0))
        with np.errstate(divide="ignore", over="ignore"):
            weakness = self._min_power * r**2 * np.exp(2.0 * self.attenuation * r) / darkest
            weak = self.weak_sigma * np.sqrt(weakness) if self.weak_sigma else np.zeros_like(r)
            offset = math.sqrt(np.mean(np.square(self.ring_offsets))) if self.ring_offsets else 0.0
            constant = math.hypot(self.sigma, self.ring_sigma, offset, self.resolution / math.sqrt(12.0))
            return np.hypot(np.hypot(constant, self.sigma_growth * r), weak)

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the lidar."""
        from warpvis.kernels.sensors.lidar_noise import measure_lidar

        rays = cast(Rays, exposure.camera)
        device = exposure.scene.device
        model, inputs = self._model(), _range_inputs(rays)
        inputs.seed = exposure.seed
        images = {name: getattr(exposure, name) for name in ("true_depth", "draws", "normals", "segmentation")}
        write_fields(inputs, **{name: image for name, image in images.items() if image is not None})
        if exposure.segmentation is not None:
            values = reflectivities(exposure.scene, self.reflectivity)
            inputs.reflectivity = wp.array(values, dtype=wp.float32, device=device)
        along, span = rays_on_device(rays, device), _span(rays, device)
        glare = self._glare(exposure, rays, along, model, inputs, span)
        given = [along, *self._rings(rays, device), exposure.incidence, model, glare, inputs, span]
        exposure.launch(measure_lidar, *given, kernel_images(exposure), cameras=[exposure.poses], rows=1)

    def _glare(
        self, exposure: Exposure, rays: Rays, along: wp.array, model: LidarModel, inputs: SensorInputs, span: int
    ) -> Glare:
        """Return the neighbors of rays and the power that they receive."""
        from warpvis.kernels.sensors.lidar_noise import Glare, receive_power

        if not self.glare:
            return Glare()
        glare = prepare_glare(rays, self.glare, self.glare_angle, exposure.scene.device)
        glare.power = exposure.scratch("power", exposure.true_depth.shape, wp.float32)
        given = [along, exposure.incidence, model, inputs, span, glare.power]
        exposure.launch(receive_power, *given, cameras=[exposure.poses], rows=1)
        return glare

    def apply(
        self,
        returns: Returns,
        rays: Rays,
        *,
        falls_off: bool = False,
        seed: int = 0,
        frame: int | ArrayInput | None = None,
        view_index: ArrayInput | None = None,
        out: Returns | None = None,
    ) -> Returns:
        """Add the noise to exact returns of `gather_returns`, such as dual returns.

        Power follows from the intensity of returns instead of `reflectivity`. A return from a drop of rain replaces the
        first return of its beam if it is nearer; its intensity is that of the weakest detected return.

        Args:
            returns: Ranges and intensities, with intensities of `reflect`.
            rays: The rays of the lidar, without `spread_beams`: one for each beam, shape ``(H, W)`` or ``(N,)``.
            falls_off: The option of `reflect` with which intensities were computed.
            seed: Seed of the random numbers, as for `warpvis.Renderer`.
            frame: Frame number of the random numbers: one number, or one for each view, shape ``(V,)``. By default,
                each call uses the next frame number of its seed in this process.
            view_index: View numbers of the random numbers, shape ``(V,)``, by default 0 to V - 1.
            out: The result of an earlier call, to be overwritten; it may be `returns`.

        Returns:
            Measured ranges and intensities, of the same shape; +inf and 0 for returns that are not detected.
        """
        from warpvis.kernels.sensors.lidar_noise import measure_returns

        require_rays(rays)
        self._check_rings(rays)
        if self.glare:
            raise ArrayError(f"glare must be 0 for returns of beams, got {self.glare}")
        falls_off, seed = check_flag(falls_off, "falls_off"), check_word(seed, "seed")
        given = _check_returns(returns, "returns")
        shape, device = given.range.shape, given.range.device
        if shape[2:] != rays.shape:
            raise ArrayError(f"returns must have shape (V, R, {', '.join(map(str, rays.shape))}), got {shape}")
        found = given if out is None else _check_returns(out, "out")
        result = Returns(
            take_out(out and found.range, wp.float32, shape, name="out.range", device=device),
            take_out(out and found.intensity, wp.float32, shape, name="out.intensity", device=device),
        )
        numbers = view_numbers(shape[0], next_frame(seed) if frame is None else frame, view_index).astype(np.uint32)
        inputs = _range_inputs(rays)
        inputs.seed, inputs.draws = seed, wp.array(numbers, dtype=wp.vec2ui, device=device)
        rows = shape[0], shape[1] * rays.height, rays.width
        images = [image.reshape(rows) for image in (given.range, given.intensity)]
        targets = [image.reshape(rows) for image in (result.range, result.intensity)]
        span = _span(rays, device)
        options = [*self._rings(rays, device), falls_off, self._model(), inputs, span]
        launch_images(
            measure_returns, rows, lambda window: [window, *images, *options, *targets], device=device, span=span
        )
        return result if out is None else out

    @property
    def _min_power(self) -> float:
        """Limit of detection, in units of a white surface's power at 1 m."""
        return self.detection_reflectivity / self.detection_range / self.detection_range

    @property
    def _has_ring_errors(self) -> bool:
        return self.ring_sigma > 0.0 or self.ring_offsets is not None

    def _check_rings(self, rays: Rays) -> None:
        """Check that rays have rings if rings have errors, and an offset for each."""
        if not self._has_ring_errors:
            return
        if rays.rings is None:
            given = "ring_sigma" if self.ring_offsets is None else "ring_offsets"
            raise CameraError(f"camera must be rays with rings for {given}, got rays without")
        last = int(rays.rings.max())
        if self.ring_offsets is not None and len(self.ring_offsets) <= last:
            raise ArrayError(
                f"ring_offsets must have a number of m for each ring from 0 to {last}, got {len(self.ring_offsets)}"
            )

    def _model(self) -> LidarModel:
        """Return the parameters as a struct for kernels."""
        from warpvis.kernels.sensors.lidar_noise import LidarModel

        model = LidarModel()
        for name in (*_ERRORS, *_PROBABILITIES, "false_range"):
            setattr(model, name, getattr(self, name))
        model.min_power = self._min_power
        model.attenuation = 2.0 * self.attenuation * _LOG2_E
        return model

    def _rings(self, rays: Rays, device: wp.Device) -> tuple[wp.array | None, wp.array | None]:
        """Return the ring of each ray, ``(height, width)``, and the offsets of rings; None if there are none."""
        if not self._has_ring_errors:
            return None, None
        assert rays.rings is not None  # checked by `_check_rings`
        image = rays.rings.reshape(rays.height, rays.width)
        rings = rays.prepared(("rings", device.alias), lambda: wp.array(image, dtype=wp.int32, device=device))
        offsets = self.ring_offsets
        return rings, None if offsets is None else wp.array(offsets, dtype=wp.float32, device=device)


def _range_inputs(rays: Rays) -> SensorInputs:
    """Return inputs of kernels with the range of depth of rays."""
    from warpvis.kernels.sensors.noise import SensorInputs

    inputs = SensorInputs()
    inputs.camera.near, inputs.camera.far, inputs.camera.height = rays.near, rays.far, rays.height
    return inputs


def _span(rays: Rays, device: wp.Device) -> int:
    """Return the number of rays of a row per thread: copying arguments on a CPU takes longer than measuring a ray."""
    return rays.width if device.is_cpu else 1


def _check_returns(returns: object, name: str) -> Returns:
    """Return `returns` if it has ranges and intensities of the same shape on one device."""
    if not isinstance(returns, Returns):
        raise ArrayError(f"{name} must be Returns, got {type(returns).__name__}")
    ranges = returns.range
    if not isinstance(ranges, wp.array) or ranges.dtype is not wp.float32 or ranges.ndim not in (3, 4):
        raise ArrayError(f"{name}.range must be a wp.array of float32 of shape (V, R, H, W) or (V, R, N)")
    check_out(returns.intensity, wp.float32, ranges.shape, name=f"{name}.intensity", device=ranges.device)
    return returns


def _check_size(value: object, name: str, unit: str) -> None:
    """Check that `value` is a finite number from 0 up."""
    if not is_number(value) or not 0.0 <= value < math.inf:
        raise ArrayError(f"{name} must be a finite number{unit} from 0 up, got {value!r}")


def _check_distance(value: object, name: str) -> None:
    """Check that `value` is a distance above 0, which may be infinite [m]."""
    if not is_number(value) or not value > 0.0:
        raise ArrayError(f"{name} must be above 0 m, got {value!r}")
