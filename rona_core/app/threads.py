"""Keep sums in one order: linear algebra on one thread gives the same bits on every run."""

from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def use_one_thread() -> None:
    """Limit the linear algebra of this process to one thread, once and for good.

    On several threads, sums are taken in an order that depends on their number, and the last bits
    of a result with it. A replay compares results bit by bit.
    """
    ThreadpoolController().limit(limits=1)
