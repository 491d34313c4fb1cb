"""The result of a diagnosis on disk and as a page."""
