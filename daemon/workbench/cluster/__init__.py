"""Work on other machines, by dask.distributed: who may do it, and how it is sent there."""
