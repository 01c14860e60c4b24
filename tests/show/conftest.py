"""One page of two fields, of an eighth of the suns, for all tests of pages that need no light of their own."""

import pytest
from browser import close_browser
from closed_sky import COARSE, closed

from twilight.engine import sun_tables
from twilight.show.skies import view_fields


@pytest.fixture(scope="session")
def page_of_two(tmp_path_factory):
    """Closed skies, the second twice as bright, at three altitudes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sun_tables, "SUN_COUNT", 13)
        page = view_fields(
            [closed(level=0.1), closed("other", 0.2)],
            names=["one", "other"],
            scenes=["continental-average --quality draft", "'my air.yaml' --set aerosol.load=2"],
            altitudes_km=[0.0, 5.0, 60.0],
            nodes=COARSE,
        )
    return page.save(tmp_path_factory.mktemp("two") / "two.html")


@pytest.fixture(scope="module", autouse=True)
def one_browser_for_the_tests_of_a_file():
    """It ends before other files run loops of asyncio."""
    yield
    close_browser()
