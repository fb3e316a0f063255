"""What an upset did to PV, without a model: how far, how long, whether beyond and whether ringing (derived)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from monitor.contract.samples import Array
from monitor.detect.event import INTERRUPTED, SETTLED, TIMED_OUT, ClosedEvent

STANDS_OUT_SD = 5.0
"""Standard deviations of PV's noise, and of the quiet error, that an upset must exceed to be recorded."""
STANDS_OUT_RATIO = 1.5
"""Times the largest excursion of the quiet stretch before it: what a loop does all the time is no upset."""
AFTER_PART, AFTER_SD, LEAST_AFTER_POINTS = 4, 4.5, 8
"""Part of the event, its last, by whose standard deviation it is measured likewise: it lies still there."""
BAND_SHARE, BAND_SD = 0.05, 4.0
"""PV is back when it stays within this share of the upset's size, or within so many standard deviations of the short
average of a quiet error: the range of noise over some minutes."""
STAYED_SHARE = 0.2
"""Share of the recovery for which PV has to have stayed there in an event that was cut short: it may only pass by."""
WAVE_SHARE = 0.02
"""Share of the size from which a half wave after it counts, if it is beyond the noise."""
SIZE_ERROR_SHARE = 0.02
"""Share of the size that its error by noise shall not exceed where PV leaves the time for so many points."""
SMOOTHED_SHARE = 4
"""Of the points for which PV is beyond half of its excursion, the part over which it is averaged: a curve loses 1 %."""
SHORT_POINTS = 9.0
"""Points of a plain average as noisy as the short average."""
WIDTHS = (1, 3, 9, 27)
"""Points of the averages in which the peak is looked for."""
LEAST_CURVED_POINTS = 5
"""Points from which a parabola describes the peak; fewer are averaged."""
LEAST_SWINGS, SWING_RATIO = 5, 0.5
"""Half waves from which the last three may not be above this share of the largest: that is an oscillation. So are as
many that did not come to rest in time."""
SP_MOVED_SHARE = 0.02
"""Of the excursion, by which a set point that has moved ends what is looked at."""
RINGS = 0.3
"""Damping below which PV rings: more than three half waves are seen (each leaves 37 % of the last)."""


@dataclass(frozen=True, slots=True)
class Upset:
    """An upset as far as it was seen."""

    size: float
    """Largest excursion from the level before, signed [PV]."""
    onset: float
    """From the window's time zero [s]."""
    recovery: float | None
    """From the onset until PV stays where it was [s]; None where that was not seen."""
    overshoot: float | None
    """Largest excursion to the other side, as a share of the size; None where it might still have come."""
    damping: float | None
    """Of the half waves that followed; None where there were none."""

    @property
    def rings(self) -> bool:
        """Whether PV swings for long."""
        return self.damping is not None and self.damping < RINGS


def measured(event: ClosedEvent) -> Upset | None:
    """Measure an upset; None where it does not stand out of what the loop did before, or is an oscillation.

    Parameters
    ----------
    event
        A suspected load step, without outliers.
    """
    time, error, quiet = _error(event)
    if len(error) <= quiet + 2:
        return None
    peak, side, sides = _peak(error, quiet, event.noise)
    size = _size(error, peak, side, (sides, event.noise))
    if event.thinned:  # the top may have been left out
        size = side * max(side * size, event.amplitude)
    points = _odd(sum(sides) // SMOOTHED_SHARE) if event.noise > 0.0 else 1
    smooth, band = _average(error, points), _band(event, size, points)
    waves = _waves(smooth[quiet:], _wave(event, size, points))
    least = max(_usual(event, error, smooth, quiet), _noise_band(event, points))
    if abs(size) < least or _oscillates(waves, event.state):
        return None
    onset = _onset(time, smooth, quiet, band)
    # what comes after a short peak may be slow: there is time to see it better
    slow = max(points, _slow_points(smooth[peak:], band) if event.noise > 0.0 else 1)
    smooth, band = _average(error, slow), _band(event, size, slow)
    back = _back(time, smooth, peak, band)
    stays = event.state == SETTLED or (back is not None and time[-1] - back >= STAYED_SHARE * (back - onset))
    back = back if stays else None
    after = _waves(smooth[peak:], _wave(event, size, slow))
    beyond = max((-side * wave for wave in after if wave * side < 0.0), default=0.0)
    seen = beyond > 0.0 or back is not None
    return Upset(
        size=size,
        onset=onset,
        recovery=None if back is None else back - onset,
        overshoot=beyond / abs(size) if seen else None,
        damping=_damping(abs(size), after[1:] if after and after[0] * side > 0.0 else after),
    )


def _usual(event: ClosedEvent, error: Array, smooth: Array, quiet: int) -> float:
    """Return the excursion from which an upset stands out of what the loop does before and after it [PV]."""
    before = max(
        STANDS_OUT_SD * max(event.noise, event.error_sd),
        STANDS_OUT_RATIO * float(np.max(np.abs(smooth[:quiet]))),
    )
    if event.state == INTERRUPTED:
        return before
    # a loop that has been known for a short while may be more restless than it was thought to be
    after = error[-max((len(error) - quiet) // AFTER_PART, LEAST_AFTER_POINTS) :]
    at = np.linspace(-1.0, 1.0, len(after))
    # the tail of an upset that came to rest is no restlessness
    bow = np.polyval(np.polyfit(at, after, 2), at) if event.state == SETTLED else 0.0
    rest = after - bow
    return max(before, AFTER_SD * float(np.std(rest)))


def _noise_band(event: ClosedEvent, points: int) -> float:
    """Return the range of noise in an average over so many points [PV]; the short average is as one over nine."""
    white = event.noise**2 * max(1.0 / points - 1.0 / SHORT_POINTS, 0.0)
    return BAND_SD * math.sqrt(event.short_sd**2 + white)


def _band(event: ClosedEvent, size: float, points: int) -> float:
    return max(BAND_SHARE * abs(size), _noise_band(event, points))


def _wave(event: ClosedEvent, size: float, points: int) -> float:
    return max(WAVE_SHARE * abs(size), _noise_band(event, points))


def _slow_points(after: Array, band: float) -> int:
    """Return the points of an average that leaves what comes after the peak as it is."""
    out = np.flatnonzero(np.abs(after) > band)
    return _odd(int(out[-1]) // (2 * SMOOTHED_SHARE * max(len(_waves(after, band)), 1))) if len(out) else 1


def _error(event: ClosedEvent) -> tuple[Array, Array, int]:
    """Return time [s], PV's way from its level before [PV] until the set point moves, and the quiet points."""
    w = event.window
    quiet = max(w.before // 2, 2)
    moved = np.flatnonzero(
        np.abs(w.sp[w.before :] - w.sp[w.before - 1]) > SP_MOVED_SHARE * abs(event.amplitude)
    )
    end = w.before + int(moved[0]) if len(moved) else len(w)
    error = (w.pv - w.sp)[:end]
    return w.time[:end], error - float(np.mean(error[:quiet])), quiet


def _average(values: Array, points: int) -> Array:
    """Average over an odd number of points about each."""
    if points <= 1:
        return values
    padded = np.pad(values, points // 2, mode="reflect" if points // 2 < len(values) else "edge")
    return np.convolve(padded, np.full(points, 1.0 / points), mode="valid")


def _odd(points: int) -> int:
    return max(2 * (points // 2) + 1, 1)


def _peak(error: Array, quiet: int, noise: float) -> tuple[int, float, tuple[int, int]]:
    """Return where the excursion is largest, its sign, and the points to either side beyond half of it.

    It is looked for in the average that shows it best, and then in one as wide as its own width allows.
    """
    best, at, side = -1.0, quiet, 1.0
    for points in WIDTHS if noise > 0.0 else WIDTHS[:1]:
        if points > len(error) - quiet:
            break
        smooth = _average(error, points)[quiet:]
        k = int(np.argmax(np.abs(smooth)))
        clear = abs(float(smooth[k])) * math.sqrt(points)
        if clear > best:
            best, at, side = clear, quiet + k, math.copysign(1.0, float(smooth[k]))
    left, right = _sides(error, at, side, noise)
    if noise > 0.0:
        fine = min(_points(float(_average(error, 3)[at]), noise), (left + right) // SMOOTHED_SHARE)
        first = max(at - left, quiet)
        at = first + int(np.argmax(side * _average(error, _odd(fine))[first : at + right + 1]))
    return at, side, _sides(error, at, side, noise)


def _sides(error: Array, peak: int, side: float, noise: float) -> tuple[int, int]:
    """Return the points to the left and to the right for which PV is beyond half of its largest excursion."""
    smooth = side * _average(error, 3 if noise > 0.0 else 1)
    below = np.flatnonzero(smooth < 0.5 * smooth[peak])
    left, right = below[below < peak], below[below > peak]
    first = int(left[-1]) + 1 if len(left) else 0
    last = int(right[0]) - 1 if len(right) else len(error) - 1
    return peak - first, last - peak


def _points(size: float, noise: float) -> int:
    """Return the points of a parabola that knows its peak well enough (its variance is 9/4 that of a mean)."""
    return math.ceil((1.5 * noise / (SIZE_ERROR_SHARE * abs(size))) ** 2) if size else 1


def _size(error: Array, peak: int, side: float, known: tuple[tuple[int, int], float]) -> float:
    """Return the largest excursion, signed, noise taken off: the top of a parabola over the middle of the peak."""
    (left, right), noise = known
    rough = float(_average(error, 3)[peak]) if noise > 0.0 and left + right > 1 else float(error[peak])
    share = min(_points(rough, noise) / max(left + right + 1, 1), 0.5)
    first = peak - round(share * left)
    values = side * error[first : peak + round(share * right) + 1]
    if len(values) < LEAST_CURVED_POINTS:
        return side * float(np.mean(values))
    at = np.arange(len(values)) - (len(values) - 1) / 2  # centred: the powers are better apart
    near = np.abs(np.arange(len(values)) - (peak - first)) <= len(values) // 4  # further out noise makes tops
    return side * float(np.max(np.polyval(np.polyfit(at, values, 2), at[near])))


def _waves(smooth: Array, least: float) -> list[float]:
    """Return the extremes of the half waves that go beyond ``least``, signed, in order."""
    out = smooth[np.abs(smooth) > least]
    if len(out) == 0:
        return []
    turns = np.flatnonzero(np.diff(np.sign(out))) + 1
    return [float(part[np.argmax(np.abs(part))]) for part in np.split(out, turns)]


def _oscillates(waves: list[float], state: str) -> bool:
    if len(waves) < LEAST_SWINGS:
        return False
    sizes = np.abs(waves)
    return state == TIMED_OUT or float(np.median(sizes[-3:])) > SWING_RATIO * float(np.max(sizes))


def _onset(time: Array, smooth: Array, quiet: int, band: float) -> float:
    """Return when PV began to move [s]: a straight line through where it leaves the band, and twice the band."""
    size = np.abs(smooth[quiet:])
    first = int(np.argmax(size > band))
    at = _crossing(time[quiet:], size, first, band)
    if not np.any(size[first:] > 2.0 * band):
        return at
    second = first + int(np.argmax(size[first:] > 2.0 * band))
    return max(2.0 * at - _crossing(time[quiet:], size, second, 2.0 * band), float(time[quiet]))


def _back(time: Array, smooth: Array, peak: int, band: float) -> float | None:
    """Return when PV comes back for good [s]; None where it was not seen to."""
    last = int(np.flatnonzero(np.abs(smooth) > band)[-1]) if np.any(np.abs(smooth) > band) else peak
    if last >= len(smooth) - 2:
        return None
    return _crossing(time, np.abs(smooth), last + 1, band)


def _crossing(time: Array, size: Array, k: int, level: float) -> float:
    """Return when ``level`` is crossed between the points before and at ``k``."""
    if k == 0 or size[k] == size[k - 1]:
        return float(time[k])
    share = float(np.clip((level - size[k - 1]) / (size[k] - size[k - 1]), 0.0, 1.0))
    return float(time[k - 1] + share * (time[k] - time[k - 1]))


def _damping(size: float, after: list[float]) -> float | None:
    """Return the damping by the logarithmic decrement of the half waves after the largest: d/sqrt(pi^2 + d^2).

    The upset's own counts where only one came after it.
    """
    free = np.abs(after if len(after) > 1 else [size, *after])
    if len(free) < 2:
        return None
    decrement = -float(np.polyfit(np.arange(len(free)), np.log(free), 1)[0])
    return max(decrement, 0.0) / math.hypot(math.pi, decrement)
