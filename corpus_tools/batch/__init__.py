"""One resumable job over many files: processes of this machine, or a dask cluster."""
