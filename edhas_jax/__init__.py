"""Design an electro-hydraulic actuator, and find out why the real one does not behave like the model."""

import importlib

from edhas_jax import backend as _backend  # first: it sets compiler flags, which JAX reads only once

_backend.prepare()

__version__ = "0.1.0"

# what a user needs, loaded when it is asked for: the core alone imports in a second
_PUBLIC = {
    "load": ("config", "read_config"),
    "change": ("parameters", "change"),
    "get": ("parameters", "get_parameter"),
    "simulate": ("run", "simulate"),
    "Simulation": ("run", "Simulation"),
    "Precision": ("run", "Precision"),
    "SimulationError": ("run", "SimulationError"),
    "Run": ("run", "Run"),
    "save_run": ("store", "save_run"),
    "open_run": ("store", "open_run"),
    "load_sweep": ("sweep_config", "load_sweep"),
    "run_sweep": ("sweep", "run_sweep"),
    "open_sweep": ("sweep", "open_sweep"),
    "export_fmu": ("fmu", "export_fmu"),
    "Sweep": ("sweep_config", "Sweep"),
    "read_campaign": ("campaign_reader", "read_campaign"),
    "compare": ("comparison", "compare"),
    "find_patterns": ("patterns", "find_patterns"),
    "uncertain_unknowns": ("unknown", "uncertain_unknowns"),
    "FitProblem": ("fit", "Problem"),
    "calibrate": ("fit", "fit"),
    "gradient": ("gradient_table", "gradient"),
    "GradientSettings": ("gradient_plan", "GradientSettings"),
    "diagnose_campaign": ("diagnose", "diagnose"),
    "save_diagnosis": ("diagnosis_file", "save_diagnosis"),
    "write_report": ("diagnosis_report", "write_report"),
    "next_experiment": ("plan", "next_experiment"),
    "ActuatorBench": ("system", "ActuatorBench"),
    "PumpBench": ("system", "PumpBench"),
    "ActuatorSystem": ("system", "ActuatorSystem"),
    "Sine": ("system", "Sine"),
    "Step": ("system", "Step"),
    "Chirp": ("system", "Chirp"),
    "Recorded": ("system", "Recorded"),
    "Controller": ("control", "Controller"),
    "Effect": ("effects", "Effect"),
    "par": ("tree", "par"),
    "state": ("effects", "state"),
}
__all__ = [*_PUBLIC, "__version__"]


def __getattr__(name: str):
    if name not in _PUBLIC:
        raise AttributeError(f"module edhas_jax has no attribute {name}")
    module, attribute = _PUBLIC[name]
    value = globals()[name] = getattr(importlib.import_module(f"edhas_jax.{module}"), attribute)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
