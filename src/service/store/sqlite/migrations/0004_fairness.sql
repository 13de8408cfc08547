-- Fair claims, attempts that count when they begin, and counts that need no scan.
ALTER TABLE jobs ADD COLUMN urgency INTEGER NOT NULL DEFAULT 0;  -- the priority, negated: ascending is first
ALTER TABLE jobs ADD COLUMN begun INTEGER NOT NULL DEFAULT 0;    -- whether the reading of the current attempt began
ALTER TABLE jobs ADD COLUMN suspicion INTEGER NOT NULL DEFAULT 0; -- crashes of the service while the job was worked on
ALTER TABLE jobs ADD COLUMN not_before INTEGER;                  -- of a suspect: when it may start again
ALTER TABLE jobs ADD COLUMN worker TEXT;                         -- the process that claimed it last

-- Earlier releases counted every claim as an attempt. What they counted against jobs that still live is forgotten.
UPDATE jobs SET uncounted = attempt WHERE state IN ('queued', 'running');

-- One row a tenant, kept by triggers in the transaction of each change.
CREATE TABLE tenants (
    name      TEXT    PRIMARY KEY,
    queued    INTEGER NOT NULL DEFAULT 0,
    running   INTEGER NOT NULL DEFAULT 0,
    succeeded INTEGER NOT NULL DEFAULT 0,
    failed    INTEGER NOT NULL DEFAULT 0,
    cancelled INTEGER NOT NULL DEFAULT 0
) STRICT, WITHOUT ROWID;

INSERT INTO tenants (name, queued, running, succeeded, failed, cancelled)
SELECT tenant, sum(state = 'queued'), sum(state = 'running'), sum(state = 'succeeded'), sum(state = 'failed'),
       sum(state = 'cancelled')
FROM jobs GROUP BY tenant;

CREATE TRIGGER jobs_inserted AFTER INSERT ON jobs BEGIN
    INSERT INTO tenants (name, queued, running, succeeded, failed, cancelled)
    VALUES (new.tenant, new.state = 'queued', new.state = 'running', new.state = 'succeeded', new.state = 'failed',
            new.state = 'cancelled')
    ON CONFLICT (name) DO UPDATE SET
        queued = queued + excluded.queued,
        running = running + excluded.running,
        succeeded = succeeded + excluded.succeeded,
        failed = failed + excluded.failed,
        cancelled = cancelled + excluded.cancelled;
END;

CREATE TRIGGER jobs_changed AFTER UPDATE OF state ON jobs WHEN old.state <> new.state BEGIN
    UPDATE tenants SET
        queued = queued + (new.state = 'queued') - (old.state = 'queued'),
        running = running + (new.state = 'running') - (old.state = 'running'),
        succeeded = succeeded + (new.state = 'succeeded') - (old.state = 'succeeded'),
        failed = failed + (new.state = 'failed') - (old.state = 'failed'),
        cancelled = cancelled + (new.state = 'cancelled') - (old.state = 'cancelled')
    WHERE name = new.tenant;
END;

CREATE TRIGGER jobs_deleted AFTER DELETE ON jobs BEGIN
    UPDATE tenants SET
        queued = queued - (old.state = 'queued'),
        running = running - (old.state = 'running'),
        succeeded = succeeded - (old.state = 'succeeded'),
        failed = failed - (old.state = 'failed'),
        cancelled = cancelled - (old.state = 'cancelled')
    WHERE name = old.tenant;
END;

-- What runs, what waits in the order in which a tenant's jobs are claimed, suspects, and lists by tenant and state.
DROP INDEX jobs_by_state;
CREATE INDEX jobs_running ON jobs (number) WHERE state = 'running';
CREATE INDEX jobs_waiting ON jobs (tenant, urgency, number) WHERE state = 'queued';
CREATE INDEX jobs_suspect ON jobs (state, not_before) WHERE suspicion > 0;
CREATE INDEX jobs_by_tenant_and_state ON jobs (tenant, state, number);

-- One row: what must outlast the process and is no job.
CREATE TABLE secrets (
    id      INTEGER PRIMARY KEY,
    cursors BLOB NOT NULL -- key of the cursors of lists
) STRICT;
