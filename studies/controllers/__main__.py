"""Run the comparison of controllers: `python -m studies.controllers`."""

from studies.controllers.comparison import main

if __name__ == "__main__":
    main()
