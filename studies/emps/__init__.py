"""Does identification hold on a real drive? The EMPS benchmark; its data set is not part of the project."""
