"""The electro-hydraulic drive: the plain machine without losses, and the effects that it may lack."""

import math

import jax.numpy as jnp

from edhas_jax import Body, Effect, Oil, OilNode, Reservoir, Rig, drive, par, signal, slot, state, struct

PSI, INCH, GALLON = 6894.757, 0.0254, 3.785412e-3  # Pa, m, m³
FLOW_PER_PRESSURE = GALLON / 60.0 / PSI  # a gallon per minute and psi in m³/(s·Pa)
RPM = 2.0 * math.pi / 60.0  # rad/s


@struct
class GasSpring:
    """Gas that the ram compresses: p = p₀ V₀/V θ, θ its temperature over that of its surroundings, 1 at the start.

    Source: first law of an ideal gas with heat exchange, as Pourmovahed and Otis use it for accumulators (1990).
    """

    area: float = par(0.0115, "m^2", (1e-4, 1.0), "area of the piston")
    dead_volume: float = par(0.0363, "m^3", (1e-4, 1.0), "gas volume when the piston is at the end")
    start_pressure: float = par(1e6, "Pa", (1e4, 1e8), "pressure at the start p₀, absolute")
    start_travel: float = par(1.9, "m", (0.0, 10.0), "travel of the piston from the end at the start")
    exponent: float = par(1.38, "-", (1.0, 1.7), "exponent n of a change without exchange of heat")
    cooling_time: float = par(15.0, "s", (0.1, 1e4), "time constant with which it takes the surroundings' temperature")

    def volume(self, travel):
        """The volume of the gas [m³] at `travel` [m] of the piston from the end."""
        return self.dead_volume + self.area * travel

    def pressure(self, travel, temperature):
        """The pressure [Pa] at `travel` [m] of the piston from the end."""
        return self.start_pressure * self.volume(self.start_travel) / self.volume(travel) * temperature

    def temperature_rate(self, travel, speed, temperature):
        """The rate of the relative temperature [1/s]."""
        expansion = self.area * speed / self.volume(travel)
        return -(self.exponent - 1.0) * temperature * expansion - (temperature - 1.0) / self.cooling_time


class PowerTakeOff(Rig):
    """A ram, moved from outside, pushes oil through a hydraulic motor that turns an electric machine; gas springs help.

    Extending, the ram presses oil from its lower side through the motor to its upper side. Positive are extension, the
    force that extends, speed of the motor with flow from the upper to the lower side, and a current that holds back an
    extension. The side that is not under load is open to the tank.

    Source of the numbers: the owners of the drive (MBARI), who publish them with the records.
    """

    time_step, duration = 4e-3, 400.0  # s

    ram_position = drive("m", "position of the ram, 0 when retracted", 0.1)
    ram_acceleration = drive("m/s^2", "acceleration of the ram in its record", 0.0)
    current = drive("A", "current of the windings", 0.0)

    oil: Oil = Oil(oil_bulk_modulus=1.2e9)
    low: GasSpring = GasSpring()
    up: GasSpring = GasSpring(area=0.0127, dead_volume=0.0226, start_travel=0.1)
    ram_area: float = par(1.375 * INCH**2, "m^2", (1e-5, 1e-1), "area of the ram on both sides")
    displacement: float = par(0.30 * INCH**3 / (2 * math.pi), "m^3/rad", (1e-9, 1e-4), "volume per angle of the motor")
    torque_constant: float = par(0.438, "N*m/A", (1e-3, 10.0), "torque per current of the electric machine")
    inertia: float = par(1e-3, "kg*m^2", (1e-6, 1.0), "moment of inertia of motor and electric machine")
    line_volume: float = par(5e-4, "m^3", (1e-6, 1.0), "oil on each side when the ram is at the end there")
    stroke: float = par(2.03, "m", (0.1, 10.0), "stroke of the ram")
    shuttle: float = par(3e-10, "m^3/(s*Pa)", (0.0, 1e-6), "flow per pressure between the unloaded side and the tank")
    tank_pressure: float = par(101325.0, "Pa", (1e4, 1e6), "pressure in the tank, absolute")
    lower_start: float = par(101325.0, "Pa", (1e4, 1e8), "oil pressure on the lower side at the start, absolute")
    dead_force: float = par(-1000.0, "N", (-1e5, 1e5), "constant force against the ram: weight, and air on the rods")

    motor_speed = state("rad/s", "speed of the motor")
    lower_pressure = state("Pa", "oil pressure on the lower side, absolute", "lower_start")
    upper_pressure = state("Pa", "oil pressure on the upper side, absolute", "tank_pressure")
    lower_warmth = state("-", "temperature of the lower gas over that of its surroundings", 1.0)
    upper_warmth = state("-", "temperature of the upper gas over that of its surroundings", 1.0)
    lower_gas = signal("Pa", "pressure of the lower gas spring, absolute")
    upper_gas = signal("Pa", "pressure of the upper gas spring, absolute")
    ram_speed = signal("m/s", "speed of the ram")
    ram_jerk = signal("m/s^3", "rate of the acceleration in the record of the ram")
    ram_force = signal("N", "force of the test machine on the ram")
    drop = signal("Pa", "oil pressure of the lower side less that of the upper side")

    smoothing = slot("recorder", "m/s", "speed of the ram that its record lacks", "ram_jerk", 0.01)
    bypass = slot("relief", "m^3/s", "oil from the lower to the upper side past the motor", "drop", 1e-5)
    motor_drag = slot("motor", "N*m", "torque against the rotation of the motor", "motor_speed", 0.1)
    seal_drag = slot("ram", "N", "force against the motion of the ram", "ram_speed", 50.0)

    def equations(self, y, s):
        """The rates of all states; sets the pressures of the gas, speed and force of the ram."""
        s.set(ram_jerk=s.ram_acceleration_rate, drop=y.lower_pressure - y.upper_pressure)
        x, drop = s.ram_position, s.drop
        v = s.ram_position_rate + self.smoothing.apply(0.0 * drop, s)
        low, up = self.low.pressure(self.stroke - x, y.lower_warmth), self.up.pressure(x, y.upper_warmth)
        s.set(ram_speed=v, lower_gas=low, upper_gas=up)
        tank = Reservoir(s, "tank", self.tank_pressure + 0.0 * y.motor_speed)
        lower = OilNode(s, "lower_pressure", self.oil, self.line_volume + self.ram_area * (self.stroke - x))
        upper = OilNode(s, "upper_pressure", self.oil, self.line_volume + self.ram_area * x)
        motor = Body(s, "motor_speed", self.inertia)

        lower.add(self.ram_area * v)
        upper.add(-self.ram_area * v)
        upper.flow_to(lower, self.displacement * y.motor_speed, "")
        motor.add(self.torque_constant * s.current - self.displacement * drop)
        motor.add(-self.motor_drag.apply(0.0 * drop, s))
        lower.flow_to(upper, self.bypass.apply(0.0 * drop, s), "past the motor")
        loaded = 0.5 + 0.5 * jnp.tanh(drop / 1e5)
        lower.flow_to(tank, self.shuttle * (1.0 - loaded) * (lower.pressure - tank.pressure), "lower shuttle valve")
        upper.flow_to(tank, self.shuttle * loaded * (upper.pressure - tank.pressure), "upper shuttle valve")

        springs = self.low.area * low - self.up.area * up
        s.set(ram_force=self.ram_area * drop + springs + self.dead_force + self.seal_drag.apply(0.0 * drop, s))
        return {
            "lower_warmth": self.low.temperature_rate(self.stroke - x, -s.ram_position_rate, y.lower_warmth),
            "upper_warmth": self.up.temperature_rate(x, s.ram_position_rate, y.upper_warmth),
        } | motor.rates() | lower.rates() | upper.rates() | tank.rates()  # fmt: skip


class SmoothedRecord(Effect, rig=PowerTakeOff):
    """The record of the ram is smoothed forwards and backwards, which takes away what changes within its window.

    To second order a symmetric window of variance 2a turns x into x + a x″, so that x is the record less a times its
    own second derivative.
    """

    half_variance: float = par(0.01, "s^2", (0.0, 1.0), "half the variance a of the window", plausible=(1e-3, 0.1))

    def smoothing(self, s, z):
        """The speed that the record lacks [m/s]."""
        return -self.half_variance * s.ram_jerk


class ReliefValve(Effect, rig=PowerTakeOff):
    """Where the lower pressure exceeds the upper one by the opening pressure, oil flows past the motor."""

    slope: float = par(0.02 * FLOW_PER_PRESSURE, "m^3/(s*Pa)", (0.0, 1e-6), "flow per pressure above the opening",
                       plausible=(0.002 * FLOW_PER_PRESSURE, 0.2 * FLOW_PER_PRESSURE))  # fmt: skip
    opening: float = par(2850 * PSI, "Pa", (0.0, 1e8), "pressure at which it opens", plausible=(1500 * PSI, 5400 * PSI))

    def bypass(self, s, z):
        """The flow past the motor [m³/s]."""
        return self.slope * jnp.maximum(s.drop - self.opening, 0.0)


class MotorLeakage(Effect, rig=PowerTakeOff):
    """Oil leaks past the motor in proportion to the pressure."""

    conductance: float = par(2e-13, "m^3/(s*Pa)", (0.0, 1e-9), "flow per pressure", plausible=(2e-14, 2e-12))

    def bypass(self, s, z):
        """The flow past the motor [m³/s]."""
        return self.conductance * s.drop


class MotorCoulomb(Effect, rig=PowerTakeOff):
    """Coulomb friction of the motor: a torque against its rotation that hardly depends on its speed, smooth over
    100 revolutions per minute.
    """

    torque: float = par(0.16, "N*m", (0.0, 10.0), "torque", plausible=(0.02, 2.0))

    def motor_drag(self, s, z):
        """The torque [N·m]."""
        return self.torque * jnp.tanh(s.motor_speed / (100.0 * RPM))


class MotorViscous(Effect, rig=PowerTakeOff):
    """Viscous friction of the motor: a torque against its rotation, in proportion to its speed."""

    drag: float = par(1.2e-3, "N*m*s", (0.0, 1.0), "torque per speed", plausible=(2e-4, 2e-2))

    def motor_drag(self, s, z):
        """The torque [N·m]."""
        return self.drag * s.motor_speed


class SealCoulomb(Effect, rig=PowerTakeOff):
    """Coulomb friction of the seals: a force against the motion of the ram that hardly depends on its speed."""

    force: float = par(300.0, "N", (0.0, 1e5), "force", plausible=(20.0, 4000.0))

    def seal_drag(self, s, z):
        """The force [N]."""
        return self.force * jnp.tanh(s.ram_speed / 2e-3)


class SealViscous(Effect, rig=PowerTakeOff):
    """Viscous friction of the seals: a force against the motion of the ram, in proportion to its speed."""

    drag: float = par(1000.0, "N*s/m", (0.0, 1e6), "force per speed", plausible=(100.0, 1e4))

    def seal_drag(self, s, z):
        """The force [N]."""
        return self.drag * s.ram_speed
