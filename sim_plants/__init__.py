"""Simulated plants under PID control, with their truth: what is watched when there is no plant.

Layers, each using only those to its left: `plants`, `controllers` (what a loop is made of), `kernel`
(the compiled step), `loops` (many loops through time), `margins`, `fleet`, `scenarios`, `plantfile` (where
loops come from), `truth`, `export`, `publish` (where samples go to).
"""
