"""Settings of every test of the network."""

import pytest
import torch


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> None:
    """Small tensors gain nothing from threads, and waiting ones slow the other test processes."""
    torch.set_num_threads(1)
