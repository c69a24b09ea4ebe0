"""The paper's naturalness survey (Lyu et al., appendix A): people rate pictures from 1 to 5.

:mod:`cnca.survey.build` makes the page, :mod:`cnca.survey.serve` collects answers,
:mod:`cnca.survey.score` says what they come to.
"""
