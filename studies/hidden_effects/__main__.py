"""Run the benchmark of hidden effects: `python -m studies.hidden_effects`."""

from studies.hidden_effects.benchmark import main

if __name__ == "__main__":
    raise SystemExit(main())
