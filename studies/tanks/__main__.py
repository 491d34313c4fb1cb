"""Run the discovery of the overflow: `python -m studies.tanks FOLDER`."""

from studies.tanks.discovery import main

if __name__ == "__main__":
    main()
