"""Sign-off report, JUnit, Allure and trends as functions of the journal."""
