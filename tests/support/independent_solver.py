"""The pump bench once more, from its equations alone: plain numbers, SciPy's error control, nothing of the package.

What the effects of the library do to a run is checked against this program, in which each stands as its formula says.
"""

from collections.abc import Mapping
from math import atan, cos, exp, inf, pi, sin, sqrt, tanh

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

NOMINAL = {
    "R": 1.41, "L": 1.1e-3, "Km": 24.61, "M": 0.12, "m_add": 0.08, "c": 20.0, "c_p": 5.0, "U_max": 48.0,
    "s0": 1e5, "s1": 100.0, "s2": 2.0, "F_C": 4.0, "F_S": 6.0, "v_S": 0.02, "d_p": 12e-3, "stroke": 10e-3,
    "V_dead": 10e-9, "delta": 20e-6, "L_fit": 20e-3, "rho": 860.0, "mu": 0.04, "b_f": 1.4e9, "alpha": 0.005,
    "p_atm": 101325.0, "m_v": 4e-3, "d_seat": 5.2e-3, "k_v": 150.0, "F_0": 0.28, "c_v": 1.4, "y_max": 3e-3,
    "Cd": 0.65, "dp_t": 10e3, "k_c": 5e5, "d_c": 5.0, "V_d": 20e-6, "p_set": 6e6, "G_rv": 1e-10, "A_load": 4.2e-6,
    "p_pre": 0.2e6, "V_pre": 1e-4, "n": 1.2, "k_stop": 2e6, "d_stop": 2.0, "Kp": 1.5e4, "Ki": 2e4, "Kd": 40.0,
    "Kaw": 0.01, "k_ff": 0.96, "f": 10.0, "a": 3.5e-3, "T_ramp": 0.1, "T_oil": 313.15,
}  # fmt: skip
SIGNALS = ("piston_position", "current", "voltage", "outlet_pressure", "outlet_flow", "chamber_pressure_a")


def trajectory(effects: Mapping[str, Mapping[str, float]], times, **changed) -> dict[str, np.ndarray]:
    """Signals of a pump bench with all refined effects and `effects` {id: parameters}, at `times`, from rest."""
    bench = _Bench(effects, NOMINAL | changed)
    done = solve_ivp(
        lambda t, y: bench.rates(t, y)[0], (0.0, times[-1]), bench.start(), "LSODA", times,
        rtol=1e-7, atol=bench.tolerance(), max_step=1e-3,
    )  # fmt: skip
    assert done.success, done.message
    rows = [bench.rates(t, y)[1] for t, y in zip(done.t, done.y.T, strict=True)]
    return {name: np.array([row[name] for row in rows]) for name in SIGNALS}


class _Bench:
    def __init__(self, effects, p):
        self.effects, self.p = effects, p
        self.names = ["i", "x", "v", "z", "xi", "pA", "pB", "pd", "Vg"]
        self.names += [f"{q}{kind}{side}" for kind in "sd" for side in "AB" for q in ("y", "w")]
        two_masses = "coupling_compliance" in effects or "backlash" in effects
        suction = "suction_line_resistance" in effects or "suction_line_inertance" in effects
        self.names += [
            name for name, there in {
                "xp": two_masses, "vp": two_masses, "pm": suction, "ua": "amplifier_lag" in effects,
                "Ql": "suction_line_inertance" in effects, "Qo": "outlet_line_inertance" in effects,
                "theta": "coil_heating" in effects,
            }.items() if there
        ]  # fmt: skip

    def start(self):
        p = self.p
        at = dict.fromkeys(("pA", "pB", "pd", "pm"), p["p_pre"]) | {"Vg": p["V_pre"]}
        return [at.get(name, 0.0) for name in self.names]

    def tolerance(self):
        small = {"p": 0.5, "y": 1e-10, "w": 1e-6, "x": 1e-10, "Q": 1e-11, "V": 1e-13, "z": 1e-11}
        return [small.get(name[0], 1e-7) for name in self.names]

    def get(self, effect, parameter, absent=0.0):
        return self.effects.get(effect, {}).get(parameter, absent)

    def orifice(self, area, drop):
        p = self.p
        return p["Cd"] * area * sqrt(2.0 / p["rho"]) * drop / (drop * drop + p["dp_t"] ** 2) ** 0.25

    def beta(self, pressure):
        p = self.p
        air = p["alpha"] * p["p_atm"] / pressure
        return 1.0 / (air / pressure + (1.0 - air) / p["b_f"])

    def rates(self, t, state):
        p, get, has = self.p, self.get, self.effects
        y = dict(zip(self.names, state.tolist() if isinstance(state, np.ndarray) else state, strict=True))
        d = {}
        i, x, v = y["i"], y["x"], y["v"]
        xp, vp = y.get("xp", x), y.get("vp", v)
        th = tanh(vp / 5e-3)
        S = pi * p["d_p"] ** 2 / 4.0
        ps = p["p_pre"] * (p["V_pre"] / y["Vg"]) ** p["n"]

        # controller and amplifier
        w, tau = 2.0 * pi * p["f"], min(t / p["T_ramp"], 1.0)
        scale, rate = tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2), 30.0 * tau**2 * (1.0 - tau) ** 2 / p["T_ramp"]
        r = p["a"] * scale * sin(w * t)
        rd = p["a"] * (scale * w * cos(w * t) + rate * sin(w * t))
        wanted = p["Kp"] * (r - x) + p["Ki"] * y["xi"] + p["Kd"] * (rd - v) + p["k_ff"] * p["Km"] * rd
        limit = max(p["U_max"] - get("supply_sag", "supply_resistance") * abs(i), 0.0)
        u = min(max(wanted, -limit), limit)
        d["xi"] = r - x + p["Kaw"] * (u - wanted) / p["Kp"]
        at_coil = y.get("ua", u) - get("inverter_dead_time", "dead_time_voltage") * tanh(i / 0.05)
        if "ua" in y:
            d["ua"] = (u - y["ua"]) / get("amplifier_lag", "amplifier_time")

        # coil
        R = p["R"] * (1.0 + 0.00393 * y.get("theta", 0.0))
        Km = p["Km"] * (1.0 - get("force_constant_droop", "droop") * (x / 5e-3) ** 2)
        slope = p["L"] * get("reluctance_force", "inductance_slope") / 5e-3
        d["i"] = (at_coil - R * i - Km * v - i * v * slope) / (p["L"] + slope * x)
        force = Km * i / sqrt(1.0 + (i / get("magnetic_saturation", "saturation_current", inf)) ** 2)
        force += 0.5 * i * i * slope
        if "theta" in y:
            heat = R * i * i - y["theta"] / get("coil_heating", "thermal_resistance")
            d["theta"] = heat / get("coil_heating", "heat_capacity")

        # forces on the coil carrier, then on the plungers
        angle = 2.0 * pi * x / get("cogging_force", "cogging_pitch", 1.0) + get("cogging_force", "cogging_phase")
        force -= get("cogging_force", "cogging_amplitude") * sin(angle)
        force -= get("eddy_drag", "eddy_coefficient") * v / (1.0 + (v / get("eddy_drag", "eddy_velocity", inf)) ** 2)
        force -= get("constant_bias_force", "bias_force") + get("parasitic_spring", "spring_rate") * x
        level = p["F_C"] + (p["F_S"] - p["F_C"]) * exp(-((vp / p["v_S"]) ** 2))
        d["z"] = vp - p["s0"] * abs(vp) * y["z"] / level
        drag = p["s0"] * y["z"] + p["s1"] * d["z"] + p["s2"] * vp
        drag += get("asymmetric_friction", "forward_friction") * th * (1.0 + th) / 2.0
        drag += get("asymmetric_damping", "damping_difference") * abs(v)
        drag += get("stroke_dependent_friction", "end_friction") * (xp / 5e-3) ** 2 * th
        gauge = max(y["pA"] - p["p_atm"], 0.0) + max(y["pB"] - p["p_atm"], 0.0)
        drag += get("seal_friction", "seal_coefficient") * S * gauge * th
        drag += (y["pA"] - y["pB"]) * S
        half = p["stroke"] / 2.0
        if abs(xp) > half:
            out = 1.0 if xp > 0.0 else -1.0
            drag += out * max(0.0, p["k_stop"] * (abs(xp) - half) * (1.0 + p["d_stop"] * vp * out))
        d["x"] = v
        if "xp" in y:
            lag, speed = x - xp, v - vp
            if "backlash" in has:
                side, depth = (1.0 if lag > 0.0 else -1.0), abs(lag) - get("backlash", "backlash_width") / 2.0
                link = side * max(1e6 * depth + 20.0 * speed * side, 0.0) if depth > 0.0 else 0.0
            else:
                own = has["coupling_compliance"]
                link = own["coupling_stiffness"] * lag + own["coupling_damping"] * speed
            d["v"] = (force - p["c"] * v - link) / p["M"]
            d["xp"], d["vp"] = vp, (link - p["c_p"] * vp - drag) / p["m_add"]
        else:
            d["v"] = (force - drag - (p["c"] + p["c_p"]) * v) / (p["M"] + p["m_add"])

        # suction line, chambers, valves
        upstream, drawn, delivered, leaked = y.get("pm", ps), 0.0, 0.0, 0.0
        mu = p["mu"] * exp(-get("oil_temperature", "viscosity_exponent") * (p["T_oil"] - 313.15))
        for side, sign in (("A", 1.0), ("B", -1.0)):
            pc, flow = y[f"p{side}"], sign * S * vp
            for kind, drop in (("s", upstream - pc), ("d", pc - y["pd"])):
                lift, speed = y[f"y{kind}{side}"], y[f"w{kind}{side}"]
                area = pi * p["d_seat"] * max(lift, 0.0) * sin(pi / 4.0)
                d[f"y{kind}{side}"] = speed
                ball = pi * p["d_seat"] ** 2 / 4.0 * drop - p["F_0"] - p["k_v"] * lift - p["c_v"] * speed
                ball += p["k_c"] * max(-lift, 0.0) * max(1.0 - p["d_c"] * speed, 0.0)
                ball -= p["k_c"] * max(lift - p["y_max"], 0.0) * max(1.0 + p["d_c"] * speed, 0.0)
                ball -= get("valve_flow_force", "flow_force_coefficient") * area * drop
                film = exp(-((max(lift, 0.0) / 20e-6) ** 2)) * (1.0 + tanh(speed / 1e-3)) / 2.0
                ball -= get("valve_adhesion", "adhesion_force") * film
                d[f"w{kind}{side}"] = ball / p["m_v"]
                leak = "suction_seat_leakage" if kind == "s" else "delivery_seat_leakage"
                q = self.orifice(area + get(leak, "seat_leakage_area"), drop)
                flow += q if kind == "s" else -q
                drawn, delivered = (drawn + q, delivered) if kind == "s" else (drawn, delivered + q)
            gap = mu * exp(get("pressure_viscosity", "pressure_coefficient") * (pc + ps) / 2.0)
            factor = 12.0 * atan(sqrt(1.5)) / sqrt(1.5)
            assert abs(factor - 8.68) < 0.01
            past = pi * p["d_p"] * p["delta"] ** 3 * (pc - ps) / (8.68 * gap * p["L_fit"])
            past -= pi * p["d_p"] * p["delta"] / 2.0 * sign * vp
            leaked += past
            volume = p["V_dead"] + S * (half - sign * xp)
            d[f"p{side}"] = self.beta(pc) / volume * (flow - past)
        line = drawn
        if "pm" in y:
            own = has.get("suction_line_resistance", has.get("suction_line_inertance"))
            line = y.get("Ql", (ps - y["pm"]) / own["line_resistance"])
            d["pm"] = self.beta(y["pm"]) / 10e-6 * (line - drawn)
            if "Ql" in y:
                d["Ql"] = (ps - y["pm"] - own["line_resistance"] * line) / own["line_inertance"]

        # outlet, load, accumulator
        drop = y["pd"] - ps
        if "Qo" in y:
            out = y["Qo"]
            q = out / (p["Cd"] * p["A_load"] * sqrt(2.0 / p["rho"]))
            back = sqrt((q**4 + q * q * sqrt(q**4 + 4.0 * p["dp_t"] ** 2)) / 2.0)
            inertance = get("outlet_line_inertance", "line_inertance")
            d["Qo"] = (
                drop - get("outlet_line_inertance", "line_resistance") * out - (back if q > 0 else -back)
            ) / inertance
        elif "outlet_line_resistance" in has:
            resistance = get("outlet_line_resistance", "line_resistance")
            ends = sorted((0.0, self.orifice(p["A_load"], drop)))
            out = 0.0 if drop == 0.0 else brentq(
                lambda q: q - self.orifice(p["A_load"], drop - resistance * q), *ends, xtol=1e-16, rtol=1e-13
            )  # fmt: skip
        else:
            out = self.orifice(p["A_load"], drop)
        relief = p["G_rv"] * max(y["pd"] - p["p_set"], 0.0)
        capacity = p["V_d"] / self.beta(y["pd"]) + get("hose_compliance", "hose_compliance")
        d["pd"] = (delivered - out - relief) / capacity
        d["Vg"] = -(out + leaked + relief - line)
        seen = (x, i, u, y["pd"], out, y["pA"])
        return [d[name] for name in self.names], dict(zip(SIGNALS, seen, strict=True))
