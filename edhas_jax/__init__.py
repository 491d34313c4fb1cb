"""Design an electro-hydraulic actuator, and find out why the real one does not behave like the model."""

import importlib

__version__ = "0.1.0"

# what a user needs, loaded when it is asked for: the core alone imports in a second
_PUBLIC = {
    "load": ("config.machine_config", "read_config"),
    "trust": ("core.trusted_code", "trust"),
    "distrust": ("core.trusted_code", "distrust"),
    "change": ("machine.parameters", "change"),
    "get": ("machine.parameters", "get_parameter"),
    "simulate": ("tasks.simulate", "simulate"),
    "Simulation": ("simulation.run_settings", "Simulation"),
    "Precision": ("simulation.run_settings", "Precision"),
    "SimulationError": ("simulation.run", "SimulationError"),
    "Run": ("simulation.run", "Run"),
    "save_run": ("config.run_folder", "save_run"),
    "open_run": ("config.run_folder", "open_run"),
    "load_sweep": ("design.sweep.config", "load_sweep"),
    "run_sweep": ("design.sweep.run", "run_sweep"),
    "open_sweep": ("design.sweep.run", "open_sweep"),
    "export_fmu": ("export.fmu", "export_fmu"),
    "Sweep": ("design.sweep.config", "Sweep"),
    "read_campaign": ("measurements.campaign_reader", "read_campaign"),
    "sweep": ("tasks.sweep", "sweep"),
    "size": ("tasks.size", "size"),
    "sensitivity": ("tasks.sensitivity", "sensitivity"),
    "compare": ("tasks.compare", "compare"),
    "fit": ("tasks.fit", "fit"),
    "add": ("tasks.add", "add"),
    "diagnose": ("tasks.diagnose", "diagnose"),
    "plan": ("tasks.plan", "plan"),
    "copy_examples": ("config.examples", "copy_examples"),
    "open_result": ("tasks.result", "open_result"),
    "find_patterns": ("measurements.residual_patterns", "find_patterns"),
    "uncertain_unknowns": ("measurements.unknown_parameters", "uncertain_unknowns"),
    "FitProblem": ("inference.fit.fit", "FitProblem"),
    "calibrate": ("inference.fit.fit", "fit"),
    "model": ("design.function.model", "model"),
    "Model": ("design.function.model", "Model"),
    "gradient": ("design.gradient.table", "gradient"),
    "GradientSettings": ("design.gradient.fixed_point", "GradientSettings"),
    "save_diagnosis": ("diagnosis.report.result_file", "save_diagnosis"),
    "write_report": ("diagnosis.report.report", "write_report"),
    "next_experiment": ("diagnosis.planning.next_experiment", "next_experiment"),
    "ActuatorBench": ("machine.rigs", "ActuatorBench"),
    "PumpBench": ("machine.rigs", "PumpBench"),
    "ActuatorSystem": ("machine.rigs", "ActuatorSystem"),
    "Sine": ("machine.rigs", "Sine"),
    "Step": ("machine.rigs", "Step"),
    "Chirp": ("machine.rigs", "Chirp"),
    "Recorded": ("machine.rigs", "Recorded"),
    "Controller": ("machine.interface.controller_base", "Controller"),
    "Effect": ("machine.effects", "Effect"),
    "Oil": ("machine.components.oil", "Oil"),
    "Orifice": ("machine.components.orifice", "Orifice"),
    "Accumulator": ("machine.components.accumulator", "Accumulator"),
    "Body": ("machine.nodes", "Body"),
    "GasNode": ("machine.nodes", "GasNode"),
    "OilNode": ("machine.nodes", "OilNode"),
    "Reservoir": ("machine.nodes", "Reservoir"),
    "Rig": ("machine.rig_base", "Rig"),
    "drive": ("machine.rig_base", "drive"),
    "signal": ("machine.rig_base", "signal"),
    "metric": ("machine.interface.metrics", "metric"),
    "Mean": ("machine.interface.metrics", "Mean"),
    "Peak": ("machine.interface.metrics", "Peak"),
    "Final": ("machine.interface.metrics", "Final"),
    "WholeRun": ("machine.interface.metrics", "WholeRun"),
    "slot": ("machine.interface.slots", "slot"),
    "struct": ("core.structs", "struct"),
    "par": ("core.structs", "par"),
    "state": ("machine.effects", "state"),
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
