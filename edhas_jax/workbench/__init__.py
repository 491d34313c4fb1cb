"""The workbench: the loop of comparing, diagnosing and designing on a page in the browser of this machine."""
