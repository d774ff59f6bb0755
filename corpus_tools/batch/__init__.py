"""One resumable job over many items: on processes of this machine or on a dask cluster."""

from corpus_tools.batch.item import Context, Item, ItemResult, Job, catch_warnings
from corpus_tools.batch.progress import BatchProgress
from corpus_tools.batch.run import run_batch

__all__ = ["BatchProgress", "Context", "Item", "ItemResult", "Job", "catch_warnings", "run_batch"]
