"""The keys of `campaign.yaml`."""

import functools

from edhas_jax.config.declared_keys import (
    YES_NO,
    Key,
    Keys,
    Kind,
    by_name,
    choice,
    list_of,
    own_value,
    size_in,
    text_value,
)
from edhas_jax.config.machine_keys import machine_keys
from edhas_jax.config.recorded_signal import BETWEEN
from edhas_jax.machine.rig_base import Rig
from edhas_jax.measurements.accuracy import BenchAccuracy, SensorAccuracy
from edhas_jax.measurements.campaign import Use

NAME = text_value(any_scalar=True)
TIME_STAMP = size_in("s", "0.2 s")
DEVIATION = "a standard deviation"
SPREAD = own_value({"type": ["string", "number", "object"]}, "`0.1`, `5 mV`, `{relative: 0.5, per: run}`")


def deviation(unit: str, example: str) -> Kind:
    """A standard deviation in an SI unit."""
    return size_in(unit, example, 0.0, what=DEVIATION, is_difference=True)


def share(example: str) -> Kind:
    """A relative standard deviation; a larger one than 100 % is a mistake in the unit."""
    return size_in("-", example, 0.0, most=1.0, what=f"a relative {DEVIATION.removeprefix('a ')}")


LAYOUT = {
    "decimal": Key(own_value({"enum": [".", ","]}, '`"."`, `","`'), "what stands before the decimals"),
    "sheet": Key(NAME, "of an Excel file"),
}
TIME = Keys({
    "column": Key(NAME, "with the time stamps", shown="`time`"),
    "unit": Key(NAME, "of the time stamps, where the header states none"),
    "start": Key(TIME_STAMP, "time stamp at which the run begins", shown="the first one"),
    "interval": Key(size_in("s", "50 ms", 0.0, above=True), "of the samples, where no column has their times"),
    "rate": Key(size_in("Hz", "20 Hz", 0.0, above=True), "the same as a rate"),
}, "{column: t, unit: ms}")  # fmt: skip
COLUMN = Keys({
    "column": Key(NAME, "its name in the files"),
    "unit": Key(NAME, "where the header states none"),
}, "{column: p_2}", short="column")  # fmt: skip
DRIVE_COLUMN = Keys({**COLUMN.keys, "between": Key(BETWEEN.kind, BETWEEN.doc, shown="`line`")},
                    "{column: xref, unit: mm, between: hold}", short="column")  # fmt: skip
FILE = Keys({
    "file": Key(text_value(example="plc.csv"), "its name", needed=True),
    "start": Key(TIME_STAMP, "time stamp at which the run begins in this file"),
    "time": Key(TIME.kind, "as of the campaign"), **LAYOUT,
}, "{file: plc.csv, start: 3 s}", short="file")  # fmt: skip
SIGNAL = Keys({
    "unit": Key(NAME, "in the files", ""),
    "noise": Key(own_value({"type": ["string", "number"]}, "above 0"), "standard deviation in that unit",
                 shown="measured"),
    "column": Key(NAME, "its name in the files, if that differs"),
    "model_error": Key(own_value({"type": ["string", "number"]}, "0 or above"),
                       "what the model may leave beside the noise, standard deviation in that unit"),
    "limits": Key(own_value({"type": "array"}, "`[0 V, 10 V]`"), "ends of the range of the sensor"),
}, "{unit: A, noise: 0.02}", short="unit")  # fmt: skip
WINDOW = Keys({
    "from": Key(TIME_STAMP, "first time", shown="the start"),
    "to": Key(TIME_STAMP, "last time", shown="the end"),
}, "{from: 0.2 s, to: 1.5 s}")  # fmt: skip
RUN = Keys({
    "file": Key(own_value({"type": "string"}, "a file"), "the run file"),
    "files": Key(own_value(list_of(FILE.kind).schema, "`[daq.csv, {file: plc.csv, time: {interval: 1 ms}}]`"),
                 "in its place: several, with their own `start`, `time`, `decimal` and `sheet`"),
    "use": Key(choice(Use), "for calibration, or for validation only", needed=True),
    "start": Key(TIME_STAMP, "time stamp at which it begins"),
    "window": Key(WINDOW.kind, "what is compared and fitted, counted from the start"),
    "running": Key(YES_NO, "whether the bench was running before", False, shown="no"),
    "uncertain": Key(by_name(SPREAD, "{first: 0.5}", "parameter"), "unknowns of this run alone"),
    "time": Key(TIME.kind, "as of the campaign"),
    "columns": Key(by_name(COLUMN.kind, "{pressure: p_2}", "signal or drive"), "that have another name in this run"),
    "keep": Key(own_value({"type": ["array", "string"]}, "`[outlet_pressure]`, `all`"), "as of the campaign"),
    "conditions": Key(by_name(own_value({}), "{frequency: 10 Hz}", "parameter"),
                      "parameters that are called like a key; all others stand beside the keys"), **LAYOUT,
}, "{file: run1.csv, use: fit, frequency: 10 Hz}", is_open=True)  # fmt: skip
CLOCK = Keys({
    "channels": Key(list_of(NAME), "signals and drives that it records"),
    "shift": Key(deviation("s", "0.2 s"), "of its clock, another one in each run"),
}, "{channels: [speed, current], shift: 0.2 s}")  # fmt: skip


def sensor_keys(unit: str, offset: str) -> Keys:
    """The keys of `accuracy.signals` of a signal in an SI unit; `offset` is an example of one."""
    usual = SensorAccuracy()
    return Keys({
        "gain": Key(share("0.3 %"), "of its gain", usual.gain, shown="0.3 %"),
        "offset": Key(deviation(unit, offset), "of its offset", usual.offset, shown="0.1 % of the range"),
        "shift": Key(deviation("s", "20 us"), "of its time", usual.shift, shown="20 µs"),
    }, "{gain: 0.3 %, offset: 2 kPa, shift: 20 us}")  # fmt: skip


_SENSOR = sensor_keys("Pa", "2 kPa")
ACCURACY = Keys({
    "trigger": Key(deviation("s", "0.2 ms"), "of the start of a record", BenchAccuracy().trigger, shown="0.2 ms"),
    "clock_error": Key(deviation("s", "20 us"), "of the time stamps, changing slowly", BenchAccuracy().clock_error,
                       shown="50 µs"),
    "recorder_filter": Key(deviation("-", "0"), "of the weight of an anti-alias filter; 0 without one",
                           BenchAccuracy().recorder_filter, shown="1"),
    "settings": Key(by_name(share("0.5 %"), "{load_orifice_area: 0.5 %}", "parameter"), "of conditions of the runs"),
    "signals": Key(Kind(by_name(own_value({}), "{outlet_pressure: {gain: 0.3 %}}", "signal").read,
                        by_name(_SENSOR.kind, "", "").schema, "by signal", _SENSOR, reads_missing=True), "of sensors"),
    "clocks": Key(by_name(CLOCK.kind, "{motor: {channels: [speed, current], shift: 0.2 s}}", "name"),
                  "further recorders"),
}, "{trigger: 0.2 ms}")  # fmt: skip


@functools.lru_cache(maxsize=8)
def campaign_keys(rig: type[Rig] = Rig) -> Keys:
    """The keys of a campaign: those of its machine, and of the measurements."""
    machine = {name: key for name, key in machine_keys(rig).keys.items() if name != "simulation"}
    return Keys(machine | {
        "name": Key(NAME, "name of the campaign", shown="that of the folder"),
        "without": Key(machine["without"].kind, "refined effects that the machine does not have; all others that the "
                       "rig can have are in it"),
        "uncertain": Key(by_name(SPREAD, "{coil_resistance: 0.02}", "parameter"),
                         "standard deviation of its true value: a share (log-normal) or with a unit (normal); common "
                         "to all runs, or `per: run`"),
        "time": Key(TIME.kind, "of the run files"),
        "signals": Key(by_name(SIGNAL.kind, "{current: {unit: A, noise: 0.02}}", "signal"), "what was measured",
                       needed=True),
        "drives": Key(own_value({"type": ["object", "null"]}, "by drive, `u` or `{column: u, unit: V, between: hold}`"),
                      "columns of the drives of a rig of one's own"),
        "accuracy": Key(ACCURACY.kind, "of the bench, standard deviations"),
        "keep": Key(own_value({"type": ["array", "string", "null"]}, "`[outlet_pressure]`, `all`"),
                    "signals of which the checks leave out no sample"),
        "runs": Key(list_of(RUN.kind, "[{file: run1.csv, use: fit}]"), "the runs", needed=True),
        **LAYOUT,
        "reference": Key(own_value({"type": ["string", "object"]}, "`xref`, `{column: xref, unit: mm, between: hold}`"),
                         "column with the recorded set point; or a set point as of a configuration"),
    })  # fmt: skip
