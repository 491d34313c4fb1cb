"""The linear drive of the EMPS benchmark as a machine of one's own: a mass, a force per volt, a cascade controller."""

from edhas_jax import Body, Rig, drive, par, signal, state
from edhas_jax.machine.interface.slots import MOTOR_FORCE, MOVER_FORCE, MOVER_FRICTION


class LinearDrive(Rig):
    """A motor pulls a carriage along a rail; its controller follows a position, u = k_v (k_p (r − x) − v).

    Friction and forces of the library act at its slots, because its states have the names that they read.

    Source: Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019.
    """

    time_step, duration = 2e-4, 25.0  # s
    slots = (MOVER_FRICTION, MOVER_FORCE, MOTOR_FORCE)

    target = drive("m", "position that the carriage shall have", 0.0)

    moved_mass: float = par(95.1, "kg", (0.1, 1e4), "mass of carriage and rotating parts, as the rail feels it")
    force_constant: float = par(35.15065, "N/V", (0.01, 1e4), "force per voltage of the command")
    position_gain: float = par(160.18, "1/s", (0.1, 1e4), "gain of the position loop k_p")
    speed_gain: float = par(243.45, "V*s/m", (0.1, 1e5), "gain of the speed loop k_v")
    start_position: float = par(0.0, "m", (-10.0, 10.0), "position at the start")
    start_speed: float = par(0.0, "m/s", (-10.0, 10.0), "speed at the start")

    piston_position = state("m", "position of the carriage", "start_position")
    piston_velocity = state("m/s", "speed of the carriage", "start_speed")
    voltage = signal("V", "command of the controller")
    sliding_velocity = signal("m/s", "speed between carriage and rail, which laws of friction read")

    def equations(self, y, s):
        """The rates of position and speed; sets the command."""
        command = self.speed_gain * (self.position_gain * (s.target - y.piston_position) - y.piston_velocity)
        s.set(voltage=command, sliding_velocity=y.piston_velocity)
        carriage = Body(s, "piston_velocity", self.moved_mass)
        carriage.add(MOTOR_FORCE.apply(1.0 + 0.0 * command, s) * self.force_constant * command, "motor", "input")
        carriage.add(MOVER_FORCE.apply(0.0 * command, s), "forces")
        carriage.add(-MOVER_FRICTION.apply(0.0 * command, s), "friction")
        return {"piston_position": y.piston_velocity} | carriage.rates()
