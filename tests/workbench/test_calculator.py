"""The calculating process: every question gets its own answer, also where the one before was given up."""

import asyncio

import pytest

from edhas_jax.workbench.calculator import CalculationCancelled, Calculator


def test_an_answer_that_nobody_waits_for_is_passed_over(campaign_folder):
    """As where a window is closed while its comparison is computed."""
    calculator = Calculator(campaign_folder)

    async def questions():
        given_up = asyncio.create_task(calculator.call("campaign.compare", "as given", "set_point"))
        while not calculator.busy_with:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.1)
        given_up.cancel()
        opened, compared = await asyncio.gather(
            calculator.call("campaign.open"), calculator.call("campaign.compare", "as given", "set_point")
        )
        return given_up.cancelled(), opened, compared

    try:
        was_cancelled, opened, compared = asyncio.run(questions())
    finally:
        calculator.stop()
    assert was_cancelled
    assert opened["name"] == "synthetic" and "matrix" not in opened
    assert set(compared["matrix"]) == {"run1", "run2", "run3"}


def test_a_calculation_that_is_cancelled_says_so_and_the_next_one_is_answered(campaign_folder):
    calculator = Calculator(campaign_folder)

    async def questions():
        cancelled = asyncio.create_task(calculator.call("campaign.compare", "as given", "set_point"))
        while not calculator.busy_with:
            await asyncio.sleep(0.01)
        calculator.cancel()
        with pytest.raises(CalculationCancelled):
            await cancelled
        return await calculator.call("campaign.open")

    try:
        assert asyncio.run(questions())["name"] == "synthetic"
    finally:
        calculator.stop()
