-- Times are microseconds since 1970-01-01 UTC; JSON columns hold what the service may come to know more of.
CREATE TABLE jobs (
    number           INTEGER PRIMARY KEY AUTOINCREMENT, -- counts the jobs ever created: the order of queue and list
    id               TEXT    NOT NULL UNIQUE,
    tenant           TEXT    NOT NULL,
    state            TEXT    NOT NULL,
    spec             TEXT    NOT NULL,                  -- JSON
    progress         TEXT    NOT NULL,                  -- JSON
    problem          TEXT,                              -- JSON
    summary          TEXT,                              -- JSON
    cancel_requested INTEGER NOT NULL DEFAULT 0,
    attempt          INTEGER NOT NULL DEFAULT 0,        -- claims so far: the fence
    uncounted        INTEGER NOT NULL DEFAULT 0,        -- of them, those that ended without fault
    lease_until      INTEGER,                           -- of a running job
    last_seq         INTEGER NOT NULL DEFAULT 0,        -- number of the last event
    untold           INTEGER,                           -- place among the ends that a webhook is to tell
    idempotency_key  TEXT,
    request_digest   TEXT,                              -- of the request that came with the key
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    ended_at         INTEGER
) STRICT;

CREATE INDEX jobs_by_state ON jobs (state, number);
CREATE INDEX jobs_by_tenant ON jobs (tenant, number);
CREATE INDEX jobs_by_end ON jobs (ended_at) WHERE ended_at IS NOT NULL;
CREATE INDEX jobs_untold ON jobs (untold) WHERE untold IS NOT NULL;
CREATE UNIQUE INDEX jobs_by_key ON jobs (tenant, idempotency_key) WHERE idempotency_key IS NOT NULL;

CREATE TABLE events (
    job  INTEGER NOT NULL,
    seq  INTEGER NOT NULL,
    kind TEXT    NOT NULL,
    data TEXT    NOT NULL,
    PRIMARY KEY (job, seq)
) STRICT, WITHOUT ROWID;

-- One row, written to see whether anything can be.
CREATE TABLE probes (
    id INTEGER PRIMARY KEY,
    at INTEGER NOT NULL
) STRICT;
