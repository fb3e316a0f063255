"""What to set: process models, PID settings, tuning rules, vendor blocks and robustness; pure functions.

Nothing is imported here, so that ``import tuners`` costs nothing; take names from the modules.
"""
