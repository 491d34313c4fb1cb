"""Every public name of `edhas_jax` with the completeness of its docstring.

    python benchmarks/public_names.py

Complete is: a first sentence; every argument under `Args:` (of a dataclass every field under `Attributes:` or `Args:`);
`Returns:` or a first sentence that says what comes back, where something does; the public methods likewise. The last
line sums up as key=value.
"""

import dataclasses
import inspect
import re

import edhas_jax

SKIPPED = {"self", "cls", "options", "values", "parameters"}  # collected by ** or said by the sentence on them


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    complete = 0
    names = [name for name in edhas_jax.__all__ if name != "__version__"]
    print(f"{'name':22}{'kind':10}what is missing")
    for name in names:
        found = getattr(edhas_jax, name)
        missing = problems(found)
        complete += not missing
        print(f"{name:22}{'class' if inspect.isclass(found) else 'function':10}{'; '.join(missing) or 'nothing'}")
    print(f"public_names={len(names)} complete={complete}")


def problems(found) -> list[str]:
    """What the docstring of a function or class lacks."""
    text = inspect.getdoc(found) or ""
    missing = [] if text else ["a docstring"]
    if not inspect.isclass(found):
        return missing + undocumented(found, text)
    if dataclasses.is_dataclass(found):
        # a part of a machine is described by its own class
        own = [
            f.name for f in dataclasses.fields(found)
            if "par" not in f.metadata and not f.name.startswith("_") and not is_part(f.default)
        ]  # fmt: skip
        inherited = " ".join(inspect.getdoc(base) or "" for base in found.__mro__)
        missing += [f"attribute {n}" for n in own if not re.search(rf"^\s+{n}:", inherited, re.MULTILINE)]
    for name, method in vars(found).items():
        if name.startswith("_") or not inspect.isfunction(method):
            continue
        doc = inspect.getdoc(method) or ""
        missing += [f"{name}: {what}" for what in (undocumented(method, doc) if doc else ["a docstring"])]
    return missing


def is_part(value) -> bool:
    """Whether a default value is a component with a docstring of its own, or a collection of such."""
    return value == () or (dataclasses.is_dataclass(value) and bool(inspect.getdoc(type(value))))


def undocumented(function, text: str) -> list[str]:
    """The arguments and the result that a docstring does not mention."""
    signature = inspect.signature(function)
    plain = [p for p in signature.parameters.values() if p.name not in SKIPPED and p.kind is not p.VAR_KEYWORD]
    missing = [f"argument {p.name}" for p in plain if not re.search(rf"(^\s+{p.name}:|`{p.name}`)", text, re.MULTILINE)]
    if len(plain) == 1 or "arguments as of" in text or "; see `" in text or "arguments and errors as of" in text:
        missing = []  # one argument is what the first sentence is about
    returns = signature.return_annotation not in (None, "None", inspect.Signature.empty)
    says = "Returns:" in text or not text.startswith(("Run ", "Simulate ", "Read ", "Make ", "Write "))
    return missing + (["what it returns"] if returns and not says else [])


if __name__ == "__main__":
    main()
