"""An event that has closed: whether its window holds all its samples."""

from __future__ import annotations

from monitor.detect.constants import OPENING_SAMPLES, RING_SAMPLES, WINDOW_POINTS
from tests.support.detection import detected, events_of
from tests.support.plants import stepped


def test_a_long_event_is_thinned_and_its_opening_is_not():
    """A window has room for so many points; the first samples are handed out beside it, as they came."""
    quick, slow = stepped(700, kp=2.0, ti=80.0), stepped(WINDOW_POINTS + 1000, kp=0.05, ti=2000.0)
    assert not events_of(detected(quick)[1])[0].thinned
    detector, found = detected(slow)
    assert events_of(found)[0].thinned
    opening = next(s for s in detector.take_stretches() if s.window.before < RING_SAMPLES)
    assert opening.window.before == RING_SAMPLES - OPENING_SAMPLES
    step = 200
    assert (opening.window.sp[: opening.window.before] == slow.sp[step - 1]).all()
    assert (opening.window.sp[opening.window.before :] == slow.sp[step]).all()
