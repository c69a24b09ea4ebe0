"""The paper's naturalness survey (Lyu et al., appendix A): people rate pictures from 1 to 5.

:mod:`cnca.jobs.survey.build` makes the page, :mod:`cnca.jobs.survey.serve` collects answers,
:mod:`cnca.jobs.survey.score` says what they come to.
"""
