"""The export formats, a file each."""
