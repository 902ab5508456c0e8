"""Recording of a survey: the session, the survey's folder, the links and the handshake.

In: a survey file and open links. Out: logs in numbered rounds. Imported by head and service.
"""
