"""Run the comparison with the published results: `python -m studies.paper`."""

from studies.paper.reproduction import main

if __name__ == "__main__":
    main()
