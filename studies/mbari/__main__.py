"""Run the discovery on the records of the drive: `python -m studies.mbari FOLDER`."""

from studies.mbari.discovery import main

if __name__ == "__main__":
    main()
