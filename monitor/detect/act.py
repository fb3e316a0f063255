"""What a sample asks to be done with the loop's window: a sum of these.

Plain numbers in a module of their own, because compiled code reads no flags of a class.
"""

from __future__ import annotations

DROP = 1
"""Forget it."""
CONFIRM = 2
"""Report that a set-point step has opened an event."""
COMPLETE = 4
"""Hand the event out, this sample included."""
CUT = 8
"""Hand the event out as it was before this sample."""
BEGIN = 16
"""Open one: the set point has begun to move."""
GO_ON = 64
"""The set point goes on moving: whatever closes or opens, that is the loop's phase."""
BEGIN_LOAD = 32
"""Open one that reaches back: a load step is suspected."""
