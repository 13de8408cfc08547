-- Ends that a webhook is to tell: rows of their own, because they outlast their jobs.
CREATE TABLE notices (
    place        INTEGER PRIMARY KEY, -- the order of the ends
    job          TEXT    NOT NULL UNIQUE,
    webhook      TEXT    NOT NULL,
    trace_parent TEXT,
    state        TEXT    NOT NULL,
    problem      TEXT,                -- JSON
    ended_at     INTEGER NOT NULL
) STRICT;

INSERT INTO notices (job, webhook, trace_parent, state, problem, ended_at)
SELECT id, spec ->> 'webhook', spec ->> 'trace_parent', state, problem, ended_at FROM jobs
WHERE untold IS NOT NULL ORDER BY untold;

DROP INDEX jobs_untold;
ALTER TABLE jobs DROP COLUMN untold;
