"""The contact sheet names every person, and escapes names."""

import re

from posefuse.report.contact_sheet import PersonCard, PersonPicture, render_contact_sheet


def test_every_person_has_a_picture_and_the_option_that_selects_it():
    picture = PersonPicture("cam1, frame 3", b"jpeg", (20, 30))
    page = render_contact_sheet([PersonCard("person_1", "0 to 2 s", (picture,)), PersonCard("<b>", "never", ())])
    assert "posefuse: 2 people" in page
    assert "<code>--person person_1</code>" in page
    assert 'src="data:image/jpeg;base64,anBlZw=="' in page
    assert "<b>" not in page
    assert "No image shows this person well." in page
    assert not re.search(r"https?:", page)


def test_no_people_are_stated():
    assert "No person was found." in render_contact_sheet([], ["A note."])
