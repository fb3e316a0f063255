"""How far off a gain may be because the process, or the load, is of another kind than the model's."""

from __future__ import annotations

import numpy as np

from monitor.contract.samples import Array
from monitor.identify.fit import Fit
from monitor.identify.misfit import ModelError
from tuners.models import INTEGRATING, SELF_REGULATING, Model

from .reference import model_of

MOST_BY_ERROR = 0.7
"""Most of one sigma of ln gain by a model error: beyond a factor of two nothing is known anyway."""
BY_LOAD = {INTEGRATING: 0.1, SELF_REGULATING: 0.3}
"""One sigma of ln gain because a load may have been of another shape than a step (measured on the fleets of
`tests/bench/mismatch`: of the true gains that lay outside of the interval after loads, most are inside with it)."""
UNDECIDED = 0.25
"""The same where the other kind of process may be the right one: a leak and a load that dies away look alike."""
LEFT_RATIO = 2.0
"""What it grows by where more than noise is left of PV."""


def share_of_model(error: ModelError, model: Model) -> Array:
    """Return the error that is seen as a share of the model, at each of its frequencies; (k,)."""
    return np.asarray(error.bound / np.abs(np.ravel(model.frequency_response(error.omega))))


def gain_doubt(fit: Fit, error: ModelError, load: bool, undecided: bool) -> float:
    """Return the variance of ln |gain| by what a window shows, or cannot show, of another process or load (derived).

    An error of the model that is seen may be one of its gain, of the same share. After a load step the load's shape is
    not known: what came through a lag looks like a step on a process with a smaller gain.

    Parameters
    ----------
    error
        Of the fit's model, as the window shows it.
    load
        The event is a load step.
    undecided
        The other kind of process is not excluded.
    """
    share = min(float(np.max(share_of_model(error, model_of(fit)), initial=0.0)), MOST_BY_ERROR)
    shape = 0.0
    if load:
        shape = max(BY_LOAD[fit.process], UNDECIDED if undecided else 0.0)
        shape *= LEFT_RATIO if fit.leaves_more else 1.0
    return share**2 + shape**2
