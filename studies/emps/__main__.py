"""Run the comparison with the published EMPS results: `python -m studies.emps FOLDER`."""

from studies.emps.published_comparison import main

if __name__ == "__main__":
    main()
