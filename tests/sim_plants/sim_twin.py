"""Naive twin of the compiled simulation: one loop, plain Python, textbook difference equations."""

import math

from sim_plants.plants import discretise


def simulate(loop, n):
    """Rows (sp, pv, op) of the first n samples; without noise and modes; loads at samples only."""
    pid, dt, plant = loop.controller, loop.true_period, discretise(loop.plant, loop.true_period)
    sps = dict(zip((round(t / dt) for t in loop.setpoint.times), loop.setpoint.sizes, strict=True))
    loads = dict(zip((round(t / dt) for t in loop.load.times), loop.load.sizes, strict=True))
    x, past = [0.0] * loop.plant.order, [0.0] * (plant.delay + 1)
    sp, load, valve = loop.pv0, 0.0, loop.op0
    lead = slope = 0.0
    e_old = pid.c * sp - loop.pv0
    integral = loop.op0 - pid.kp * (pid.b * sp - loop.pv0)
    rows = []
    for k in range(n):
        sp, load = sp + sps.get(k, 0.0), load + loads.get(k, 0.0)
        pv = loop.pv0 + x[-1]
        if loop.quantum:
            pv = loop.quantum * math.floor(pv / loop.quantum + 0.5)
        e, tf, td = pid.c * sp - pv, pid.filter_time, pid.td
        if pid.form == "series":
            # lead-lag filter (td s + 1)/(tf s + 1) of c sp - pv by backward differences; td = 0: none
            lead = (
                (tf * lead + (td + dt) * (e - loop.pv0 * (pid.c - 1)) - td * (e_old - loop.pv0 * (pid.c - 1)))
                / (tf + dt)
                if td
                else e - loop.pv0 * (pid.c - 1)
            )
            filtered = lead - (e - loop.pv0 * (pid.c - 1))
            proportional, rate = pid.b * sp - pv + filtered, sp - pv + filtered
        else:
            slope = (tf * slope + e - e_old) / (tf + dt)
            proportional, rate = pid.b * sp - pv + td * slope, sp - pv
        e_old = e
        wish = pid.kp * proportional + integral + pid.kp * dt / pid.ti * rate
        op = min(max(wish, pid.op_low), pid.op_high)
        pushes = (wish - op) * pid.kp * rate > 0
        if pid.anti_windup == "conditional" and pushes:
            op = min(max(pid.kp * proportional + integral, pid.op_low), pid.op_high)
        else:
            integral += pid.kp * dt / pid.ti * rate
        if pid.anti_windup == "tracking" and math.isfinite(pid.ti):
            integral += dt / (pid.tracking_time + dt) * (op - wish)
        rows.append((sp, pv, op))
        if abs(op - valve) > loop.stiction:
            valve = op
        past.append(valve - loop.op0 + load)
        older, newer = past[-plant.delay - 2], past[-plant.delay - 1]
        x = [
            sum(plant.phi[i][j] * x[j] for j in range(len(x)))
            + plant.older[i] * older
            + plant.newer[i] * newer
            for i in range(len(x))
        ]
    return rows
