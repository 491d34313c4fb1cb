"""Run the analysis of the flow drop: `python -m studies.flow_drop`."""

from studies.flow_drop.cause_analysis import main

if __name__ == "__main__":
    main()
