"""On measured logs the chosen model passes the floor that gain, offset, one lag and a delay set.

`python tests/floors.py FOLDER` prints the whole table.
"""

import pytest

import floors

pytestmark = pytest.mark.slow

# the floors are given to one decimal; husky's right wheel lies on its edge (80.05 for 80.1)
ROUNDING = 0.06
POLES = (1, 2, 3)  # the floors are those of one lag, and larger orders take long


@pytest.mark.parametrize("floor", floors.FLOORS, ids=lambda floor: floor.name)
def test_the_chosen_model_passes_the_floor(floor, shared_data):
    grid = floors.identify_floor(floor, shared_data, poles=POLES)
    print("\n" + floors.HEADER + "\n" + floors.row(floor, grid))
    assert floors.score(floor, grid) >= floor.fit - ROUNDING
