"""estimate.json -> the files of other tools, by suffix; one file each: `write(estimate, values, source, path)`
returns what that format cannot keep."""
