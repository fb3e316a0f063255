"""Simulated plants under PID control, with their truth: what is watched when there is no plant.

Layers, each importing what stands before it: `plants`, `controllers`, `specs` (what a loop is); `kernel`,
`arrays`, `loops` (many loops through time, compiled); `margins`, `settings`, `truth`, `fleet`, `troubles`,
`scenarios`, `plantfile` (where loops come from); `payloads`, `export`, `publish` (where samples go).
"""
