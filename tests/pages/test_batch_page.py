"""The page of a batch in a real browser: its rows, sorted and searched by hand."""

from support.browser import Shown

from ph_post.batch.page import batch_page
from ph_post.batch.rows import BatchRow

ROWS = [
    BatchRow(
        file=f"part{number:03}.ngc",
        machine="mill",
        status="compensated",
        error_gap_before=(50 + number) * 1e-6,
        error_gap_after=2e-6,
        error_gap_worst=10e-6,
        time_before=60.0,
        time_after=61.5,
        reversals=4,
        compensated=3,
        seconds=0.5,
        not_compensated="X at 1 of 4 reversals",
    )
    for number in range(400)
]
BAD = BatchRow(file="<b>bad</b>.ngc", machine="mill", status="refused", reason='line 3: "nothing" </script>')


def test_a_batch_is_sorted_and_searched(browser, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(batch_page([*ROWS, BAD], 3), encoding="utf-8")
    shown = Shown(browser, file)
    page = shown.page
    assert page.locator("h1").inner_text() == "401 results · 400 compensated, 1 refused · 3 still to come"
    tiles = " ".join(page.locator(".tile").all_inner_texts())
    assert "250 → 2.00" in tiles
    assert "75 %" in tiles
    assert "1200 of 1600" in tiles
    assert page.locator("tbody tr").count() == 300
    page.get_by_role("button", name="before µm").click()
    page.get_by_role("button", name="before µm").click()
    assert page.locator("tbody tr").first.locator("td").first.inner_text() == "part399.ngc"
    page.get_by_role("button", name="refused", exact=True).click()
    assert page.locator("tbody tr").count() == 1
    assert page.locator("tbody tr").first.inner_text().startswith("<b>bad</b>.ngc")
    page.get_by_role("button", name="all", exact=True).click()
    page.locator("input").fill("part12")
    assert page.locator("tbody tr").count() == 10
    page.locator("input").fill("")
    page.get_by_role("button", name="show all").click()
    assert page.locator("tbody tr").count() == 401
    shown.require_quiet()
    shown.close()


def test_a_page_of_no_reversals_has_no_numbers(browser, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(batch_page([BAD]), encoding="utf-8")
    shown = Shown(browser, file)
    assert shown.page.locator("h1").inner_text() == "1 results · 1 refused"
    shown.require_quiet()
    shown.close()
