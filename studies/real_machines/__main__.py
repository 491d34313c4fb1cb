"""Run the gallery: `python -m studies.real_machines FOLDER`."""

from studies.real_machines.gallery import main

if __name__ == "__main__":
    main()
