"""Examples of hypothesis that a test takes one after the other."""

from hypothesis import (
    HealthCheck,
    Phase,
    given,
    seed,
    settings,
    strategies,
)

__all__ = ["run_examples", "strategies"]


def run_examples(test, strategy, count, number=0):
    """Call a test with examples; what fails is not tried again.

    Args:
        test: Takes one example.
        strategy: What they are drawn from.
        count: How many.
        number: Seed of the draws.
    """
    options = settings(
        max_examples=count,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    seed(number)(options(given(strategy)(test)))()
